"""Speed of stack and simulator on this machine. (`make bench`)."""

import json

from experiments.benchmark import divergence_speed, figures
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
    facts = run.manifest()
    print(json.dumps({"device": facts["device"], "versions": facts["versions"]}))
