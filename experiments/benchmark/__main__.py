"""Speed of stack and simulator on this machine: `python -m experiments.benchmark` (`make bench`)."""

from experiments.benchmark.report import write
from experiments.benchmark.study import BenchStudy
from urbanjax.io.runs import cli

main = cli.experiment("benchmark", BenchStudy, anew=True)(write)

if __name__ == "__main__":
    main()
