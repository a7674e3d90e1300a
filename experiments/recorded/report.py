"""Closed loop in the place of every recorded driver."""

from experiments.common import recordings
from experiments.recorded import figures, study, table
from experiments.recorded.study import RecordedStudy
from urbanjax.io.runs import progress, report
from urbanjax.io.runs.directory import Run

CAPTION = (
    "The stack, at the size, place and speed of each recorded vehicle, for as long as its record lasts; everybody else "
    "moves as recorded and does not react. At fault: the ego's front or flank touches somebody, or it touches somebody "
    "who stands; not at fault: it stands, or is hit from behind. Progress is along the route, ours over the recorded "
    "one. Comfort from the same differences of speed and heading over one step; recorded ones hold the noise of the "
    "measurement. Brackets: 95 % intervals, of shares Wilson's, of all else from drawing whole scenes. "
    "Signals show what the map's programs say, and green where it has none."
)


def write(params: RecordedStudy, run: Run) -> None:
    """Drive, print the table, write figures and report."""
    drives, left_out, pictures, scenes = [], {}, [], []
    with progress.bar("recorded traffic") as tick:
        for path in study.paths(params):
            scene, driven = study.drives(params, path, tick)
            drives += driven
            scenes.append(scene)
            left_out[scene.name] = scene.left_out
            figures.draw_scene(scene, driven, run.path(f"{scene.name}.png"))
            pictures.append(
                report.Picture(f"{scene.name}: the stack and the recorded drives", run.path(f"{scene.name}.png"))
            )
            run.table("drives", table.rows(drives))
    signals = recordings.signals(scenes)
    run.table("signals", signals)
    pictures.append(report.Table("Signals by scene", signals))
    if params.egos == "problems":
        run.summary(table.problem_score(drives))
        columns = table.problems(drives)
        run.table("problems", columns)
        progress.show_table("planning problems", columns)
        items = [
            report.Table("Planning problems, driven in closed loop among the recorded traffic", columns),
            *pictures,
        ]
        _report(run, items)
        return
    for name, part in table.scenes_of(drives).items():
        prefix = "" if name == table.ALL else f"{name.replace('-', '_')}_"
        run.summary({f"{prefix}{key}": value for key, value in table.counts(part).items()})
        for key, value in table.score(part).items():
            run.summary(value.flat(f"{prefix}{key}"))
    columns, wrong = table.table(drives), table.failures(drives, left_out)
    run.table("scenes", columns)
    run.table("failures", wrong)
    progress.show_table("recorded traffic", {name: columns[name] for name in table.SHORT})
    progress.show_table("contacts, off the road, left out", wrong)
    figures.draw_summary(drives, run.path("recorded.png"))
    summary = report.Picture("Progress and comfort of every drive", run.path("recorded.png"))
    items = [report.Table(CAPTION, columns), report.Table("What went wrong", wrong), summary, *pictures]
    _report(run, items)


def _report(run: Run, items: list) -> None:
    section = report.Section("Among recorded traffic", [], items)
    report.write_report(
        run.path("report.html"),
        "urbanjax among recorded traffic",
        sections=[section],
        manifest=run.manifest("complete"),
    )
