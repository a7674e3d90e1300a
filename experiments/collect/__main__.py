"""The table and the report of any number of sweeps: `python -m experiments.collect outputs/evaluate/sweeps`."""

import sys

from experiments.collect.arguments import to_overrides
from experiments.collect.report import write
from experiments.collect.study import CollectStudy
from urbanjax.io.runs import cli

program = cli.experiment("collect", CollectStudy)(write)


def main() -> None:
    """The program, whose directories are named without a key."""
    sys.argv[1:] = to_overrides(sys.argv[1:])
    program()


if __name__ == "__main__":
    main()
