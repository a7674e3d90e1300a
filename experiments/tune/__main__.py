"""Tuning by gradient, and what it is compared with: `python -m experiments.tune preset=closed_loop`."""

from experiments.tune.report import write
from experiments.tune.study import TuneStudy
from urbanjax.io.runs import cli

main = cli.experiment("tune", TuneStudy)(write)

if __name__ == "__main__":
    main()
