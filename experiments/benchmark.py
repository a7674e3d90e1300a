"""Speed of stack and simulator on this machine: `python -m experiments.benchmark` (`make bench`)."""

import json

from urbanjax.io import cli, progress
from urbanjax.io.runs import Run
from urbanjax.io.studies import benchmark, candidates, divergence_speed, divergence_speed_figure, registration_speed
from urbanjax.io.studies.benchmark import BenchStudy


@cli.experiment("benchmark", BenchStudy)
def main(params: BenchStudy, run: Run) -> None:
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
    divergence_speed_figure.draw(numbers, run.path("divergence.png"))
    facts = run.manifest()
    print(json.dumps({"device": facts["device"], "versions": facts["versions"]}))


if __name__ == "__main__":
    main()
