"""The paper's Fig. 10, overtaking at five values of tau over paired starts: `python -m experiments.overtake`."""

from experiments.common.overtaking import OvertakeStudy
from experiments.overtake.report import SweptOvertakes, write
from urbanjax.io.runs import cli

main = cli.experiment("overtake", OvertakeStudy, evaluation=SweptOvertakes)(write)

if __name__ == "__main__":
    main()
