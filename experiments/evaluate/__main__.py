"""How good a driver is, where it fails and why: `python -m experiments.evaluate preset=qualification`."""

from experiments.evaluate.driving import MissionDrives
from experiments.evaluate.report import write
from experiments.evaluate.study import EvaluateStudy
from urbanjax.io.runs import cli

main = cli.experiment("evaluate", EvaluateStudy, evaluation=MissionDrives)(write)

if __name__ == "__main__":
    main()
