"""Speed of stack and simulator on this machine. (`make bench`)."""

import json

from experiments.benchmark import divergence_speed, evaluation_speed, figures
from experiments.benchmark import study as benchmark
from experiments.benchmark.study import BenchStudy
from experiments.candidates import study as candidates
from experiments.common import registration_speed
from urbanjax.io.runs import progress
from urbanjax.io.runs.directory import Run


def write(params: BenchStudy, run: Run) -> None:
    """Time it, print the table with versions and hardware, write the numbers."""
    with progress.bar("benchmark") as tick:
        numbers = benchmark.measure(params, tick)
    run.summary(numbers)
    columns = evaluation_speed.table(numbers)
    run.table("evaluation", columns)
    progress.show_table("evaluation", columns)
    if not params.only:
        _others(params, run, numbers)
    facts = run.manifest()
    print(json.dumps({"device": facts["device"], "versions": facts["versions"]}))


def _others(params: BenchStudy, run: Run, numbers: dict[str, float]) -> None:
    """Tables and figure of all but the evaluation."""
    columns = benchmark.table(numbers, params.batches)
    run.table("benchmark", columns)
    progress.show_table("benchmark", columns)
    columns = candidates.times_table(numbers)
    run.table("candidates", columns)
    progress.show_table("candidates (warm medians)", columns)
    columns = registration_speed.table(numbers)
    run.table("registration", columns)
    progress.show_table("registration", columns)
    columns = divergence_speed.table(numbers)
    run.table("divergence", columns)
    progress.show_table("divergence (warm medians)", columns)
    figures.draw(numbers, run.path("divergence.png"))
