"""The paper's Fig. 10, overtaking at five values of tau over paired starts: `python -m experiments.overtake`."""

from urbanjax.io import animation, cli, progress, report
from urbanjax.io.runs import Run
from urbanjax.io.studies import overtake, overtake_figures
from urbanjax.io.studies.overtake import OvertakeStudy

CAPTION = (
    "Means and counts over the paired starts; TTC is the least time to collision of the boxes at constant velocity. "
    "The clamp limits the reference speed by a least time to collision; it is not in the paper."
)


def study(params: OvertakeStudy, run: Run) -> report.Section:
    """Drive, write tables, figures and the GIF into the run; returns what the report shows of it."""
    with progress.bar("overtaking") as tick:
        found, times = overtake.drive(params, tick)
    run.table("overtake", overtake.table(found))
    run.table("overtake_starts", overtake.starts(found))
    run.summary({**overtake.summary(found), **times})
    table = report.Table(CAPTION, overtake.by_tau(overtake.table(found)))
    progress.show_table("overtaking", table.columns)
    start = overtake_figures.exemplar(found)
    overtake_figures.draw_fig10(found, run.path("fig10.png"), start)
    overtake_figures.draw_means(found, run.path("overtake_means.png"))
    items = [
        report.Picture(f"Fig. 10 for start {start}, whose target lane is free.", run.path("fig10.png")),
        table,
        report.Picture("Over all paired starts.", run.path("overtake_means.png")),
    ]
    if params.gif_every:
        graph = overtake.scene(params)[0].graph
        frames = overtake_figures.pictures(found, graph, start, params.gif_every)
        animation.write_gif(run.path("overtake.gif"), frames, 1.0 / (params.gif_every * params.period))
        items.append(report.Picture("The same start at every tau, in real time.", run.path("overtake.gif")))
    return report.Section("Overtaking: aggressiveness against progress", [], items)


@cli.experiment("overtake", OvertakeStudy)
def main(params: OvertakeStudy, run: Run) -> None:
    """Run the study and write its report."""
    section = study(params, run)
    report.write_report(
        run.path("report.html"), "Overtaking at five values of tau", [section], run.manifest("complete")
    )


if __name__ == "__main__":
    main()
