"""Both studies at a size for a first look, in one self-contained report: `python -m experiments.demo` (`make demo`)."""

import os

from experiments import highway, overtake
from urbanjax.io import cli, report
from urbanjax.io.runs import Run
from urbanjax.io.studies.highway import HighwayStudy
from urbanjax.io.studies.overtake import OvertakeStudy
from urbanjax.types import pytree


@pytree
class DemoStudy:
    """The two studies, small."""

    overtake: OvertakeStudy = OvertakeStudy(starts=16)
    highway: HighwayStudy = HighwayStudy(seeds=1)


@cli.experiment("demo", DemoStudy)
def main(params: DemoStudy, run: Run) -> None:
    """Run both and say where the report is."""
    sections = [overtake.study(params.overtake, run), highway.study(params.highway, run)]
    path = run.path("report.html")
    report.write_report(path, "urbanjax: a first look", sections, run.manifest("complete"))
    print(f"report: {os.path.relpath(path)}")


if __name__ == "__main__":
    main()
