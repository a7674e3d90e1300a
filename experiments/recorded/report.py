"""Closed loop in the place of every recorded driver."""

from collections.abc import Callable, Sequence

from experiments.common import recordings
from experiments.recorded import figures, study, table
from experiments.recorded.driving import Drive, batch_of, read
from experiments.recorded.study import RecordedStudy
from urbanjax.evaluation.batch import Outcome
from urbanjax.evaluation.recorded.scenes import RecordedScene
from urbanjax.evaluation.together import Batch
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


class SweptRecordings:
    """The drives of one job of a sweep."""

    def __init__(self, params: RecordedStudy, run: Run) -> None:
        """All drives of the study's files; their numbers go to a run."""
        self.params, self.run = params, run
        scenes = [study.scene_in(params, path) for path in study.paths(params)]
        self._scenes = {scene.name: scene for scene in scenes}
        self.batches = [batch_of(params.loop(), scene) for scene in scenes if scene.starts]
        self._drives: dict[str, list[Drive]] = {}

    def missing(self) -> dict[str, Batch]:
        """All parts: none is known from before."""
        return {part: batch for batch in self.batches for part in batch.parts}

    def take(self, part: str, outcomes: Sequence[Outcome], later: Callable) -> None:
        """Keep what is said of the drives of a part. Args: part; outcomes, of its drives; later, not needed."""
        scene = self._scenes[self.missing()[part].name]
        self._drives[part] = [read(scene, one) for one in outcomes]

    def finish(self) -> None:
        """Write the numbers."""
        drives = [one for part in self.missing() for one in self._drives.pop(part)]
        _write_tables(self.params, self.run, drives, list(self._scenes.values()))


def write(params: RecordedStudy, run: Run) -> None:
    """Drive, print the table, write figures and report."""
    drives, pictures, scenes = [], [], []
    with progress.bar("recorded traffic") as tick:
        for path in study.paths(params):
            scene, driven = study.drives(params, path, tick)
            drives += driven
            scenes.append(scene)
            if not run.swept:
                figures.draw_scene(scene, driven, run.path(f"{scene.name}.png"))
                picture = run.path(f"{scene.name}.png")
                pictures.append(report.Picture(f"{scene.name}: the stack and the recorded drives", picture))
            run.table("drives", table.rows(drives))
    found = _write_tables(params, run, drives, scenes)
    if run.swept:
        return
    pictures.append(report.Table("Signals by scene", found["signals"]))
    if params.egos == "problems":
        progress.show_table("planning problems", found["problems"])
        caption = "Planning problems, driven in closed loop among the recorded traffic"
        _report(run, [report.Table(caption, found["problems"]), *pictures])
        return
    progress.show_table("recorded traffic", {name: found["scenes"][name] for name in table.SHORT})
    progress.show_table("contacts, off the road, left out", found["failures"])
    figures.draw_summary(drives, run.path("recorded.png"))
    summary = report.Picture("Progress and comfort of every drive", run.path("recorded.png"))
    tables = report.Table(CAPTION, found["scenes"]), report.Table("What went wrong", found["failures"])
    _report(run, [*tables, summary, *pictures])


def _write_tables(
    params: RecordedStudy, run: Run, drives: list[Drive], scenes: list[RecordedScene]
) -> dict[str, dict[str, list]]:
    """Write tables and summary into the run; returns the tables by name."""
    found = {"signals": recordings.signals(scenes), "drives": table.rows(drives)}
    if params.egos == "problems":
        run.summary(table.problem_score(drives))
        found["problems"] = table.problems(drives)
    else:
        for name, part in table.scenes_of(drives).items():
            prefix = "" if name == table.ALL else f"{name.replace('-', '_')}_"
            run.summary({f"{prefix}{key}": value for key, value in table.counts(part).items()})
            for key, value in table.score(part).items():
                run.summary(value.flat(f"{prefix}{key}"))
        left_out = {scene.name: scene.left_out for scene in scenes}
        found |= {"scenes": table.table(drives), "failures": table.failures(drives, left_out)}
    for name, columns in found.items():
        run.table(name, columns)
    return found


def _report(run: Run, items: list) -> None:
    section = report.Section("Among recorded traffic", [], items)
    report.write_report(
        run.path("report.html"),
        "urbanjax among recorded traffic",
        sections=[section],
        manifest=run.manifest("complete"),
    )
