"""A picture of any map and what looks wrong in it: `python -m experiments.map file=PATH`."""

from experiments.map.report import write
from experiments.map.study import MapStudy
from urbanjax.io.runs import cli

main = cli.experiment("map", MapStudy)(write)

if __name__ == "__main__":
    main()
