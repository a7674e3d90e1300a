"""The lattice of a racetrack and the cheapest lap through it: `python -m experiments.racetrack file=track.csv`."""

from experiments.racetrack.report import write
from experiments.racetrack.study import RacetrackStudy
from urbanjax.io.runs import cli

main = cli.experiment("racetrack", RacetrackStudy, anew=True)(write)

if __name__ == "__main__":
    main()
