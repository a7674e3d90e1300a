"""Which numbers of the closed loop may be tuned, and how: `python -m experiments.parameters only=tunable`."""

from experiments.parameters.study import ParameterStudy
from experiments.parameters.table import write
from urbanjax.io.runs import cli

main = cli.experiment("parameters", ParameterStudy)(write)

if __name__ == "__main__":
    main()
