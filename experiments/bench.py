"""Speed of stack and simulator on this machine: `python -m experiments.bench` (`make bench`)."""

import json

from urbanjax.io import cli, progress
from urbanjax.io.runs import Run
from urbanjax.io.studies import bench
from urbanjax.io.studies.bench import BenchStudy


@cli.experiment("bench", BenchStudy)
def main(params: BenchStudy, run: Run) -> None:
    """Time it, print the table with versions and hardware, write the numbers."""
    with progress.bar("benchmark") as tick:
        numbers = bench.measure(params, tick)
    run.summary(numbers)
    columns = bench.table(numbers, params.batches)
    run.table("bench", columns)
    progress.show_table("benchmark", columns)
    facts = run.manifest()
    print(json.dumps({"device": facts["device"], "versions": facts["versions"]}))


if __name__ == "__main__":
    main()
