"""The paper's Fig. 10, overtaking at five values of tau over paired starts."""

from experiments.common import overtaking
from experiments.common.overtaking import Fig10, OvertakeDrives, OvertakeStudy
from experiments.overtake import figures, study
from urbanjax.io.figures import animation
from urbanjax.io.runs import progress, report
from urbanjax.io.runs.directory import Run
from urbanjax.sim.scenarios import overtake

CAPTION = (
    "Means and counts over the paired starts, with 95 % intervals (bootstrap of means, Wilson of shares); "
    "TTC is the least time to collision of the boxes at constant velocity. "
    "The clamp limits the reference speed by a least time to collision; it is not in the paper."
)


class SweptOvertakes(OvertakeDrives):
    """The drives of one job of a sweep."""

    def __init__(self, params: OvertakeStudy, run: Run) -> None:
        """The drives of a study, whose numbers go to a run."""
        super().__init__(params)
        self.run = run

    def finish(self) -> None:
        """Write the numbers."""
        _write_tables(self.found(), self.run)


def section(params: OvertakeStudy, run: Run) -> report.Section:
    """Drive, write tables, figures and the GIF into the run; returns what the report shows of it."""
    with progress.bar("overtaking") as tick:
        found, times = overtaking.drive(params, tick)
    _write_tables(found, run)
    if run.swept:
        return report.Section("", [], [])
    run.summary(times)
    table = report.Table(CAPTION, study.with_intervals(found))
    progress.show_table("overtaking", study.by_tau(study.table(found)))
    start = figures.exemplar(found)
    figures.draw_fig10(found, run.path("fig10.png"), start)
    figures.draw_means(found, run.path("overtake_means.png"))
    items = [
        report.Picture(f"Fig. 10 for start {start}, whose target lane is free.", run.path("fig10.png")),
        table,
        report.Picture("Over all paired starts.", run.path("overtake_means.png")),
    ]
    if params.gif_every:
        graph = overtake.road(params.scenario)
        frames = figures.pictures(found, graph, start, params.gif_every)
        animation.write_gif(run.path("overtake.gif"), frames, rate=1.0 / (params.gif_every * params.period))
        items.append(report.Picture("The same start at every tau, in real time.", run.path("overtake.gif")))
    return report.Section("Overtaking: aggressiveness against progress", [], items)


def _write_tables(found: Fig10, run: Run) -> None:
    run.table("overtake", study.table(found))
    run.table("overtake_starts", study.starts(found))
    run.summary(study.summary(found))


def write(params: OvertakeStudy, run: Run) -> None:
    """Run the study and write its report."""
    shown = section(params, run)
    if run.swept:
        return
    report.write_report(
        run.path("report.html"), "Overtaking at five values of tau", sections=[shown], manifest=run.manifest("complete")
    )
