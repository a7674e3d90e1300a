"""The lattice of a racetrack and the cheapest lap through it."""

from experiments.racetrack import figures
from experiments.racetrack import study as racetrack
from experiments.racetrack.study import RacetrackStudy
from urbanjax.io.runs import progress, report
from urbanjax.io.runs.directory import Run

CAPTION = (
    "The cheapest lap pays its length and, weighted, the integral of its squared curvature. Dijkstra is scipy's, on "
    "the very same edges. The soft value lies between the least and the hard one; its slope is compared with the "
    "edges' weights."
)


def section(params: RacetrackStudy, run: Run) -> report.Section:
    """Build, search and check; write numbers, path and figures into the run; returns what the report shows of it."""
    lap = racetrack.solve(params)
    run.summary(lap.numbers)
    run.table("racetrack_lap", racetrack.path_table(lap))
    figures.draw_course(lap, run.path("racetrack.png"))
    figures.draw_macro(run.path("macro.png"), 0.5)
    table = report.Table(CAPTION, {"quantity": list(lap.numbers), "value": list(lap.numbers.values())})
    progress.show_table("racetrack", table.columns)
    items = [
        report.Picture("The course's lattice; right, its edges and marginals.", run.path("racetrack.png")),
        table,
        report.Picture("Macro planning on its own layers past a slow leader.", run.path("macro.png")),
    ]
    return report.Section("The lattice of a course", [], items)


def write(params: RacetrackStudy, run: Run) -> None:
    """Run the study and write its report."""
    shown = section(params, run)
    report.write_report(
        run.path("report.html"), "Racetrack lattice", sections=[shown], manifest=run.manifest("complete")
    )
