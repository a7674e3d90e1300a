"""Both studies at a size for a first look, in one self-contained report. (`make demo`)."""

import os

from experiments.demo.study import DemoStudy
from experiments.highway import report as highway
from experiments.overtake import report as overtake
from urbanjax.io.runs import report
from urbanjax.io.runs.directory import Run


def write(params: DemoStudy, run: Run) -> None:
    """Run both and say where the report is."""
    sections = [overtake.section(params.overtake, run), highway.section(params.highway, run)]
    path = run.path("report.html")
    report.write_report(path, "urbanjax: a first look", sections=sections, manifest=run.manifest("complete"))
    print(f"report: {os.path.relpath(path)}")
