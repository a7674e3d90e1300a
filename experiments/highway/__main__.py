"""Closed loop in highway-env, beside highway-env's own IDM vehicle: `python -m experiments.highway`."""

from experiments.highway.report import write
from experiments.highway.study import HighwayStudy
from urbanjax.io.runs import cli

main = cli.experiment("highway", HighwayStudy)(write)

if __name__ == "__main__":
    main()
