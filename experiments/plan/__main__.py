"""One plan of one moment, drawn and explained: `python -m experiments.plan`."""

from experiments.plan.report import write
from experiments.plan.study import PlanStudy
from urbanjax.io.runs import cli

main = cli.experiment("plan", PlanStudy)(write)

if __name__ == "__main__":
    main()
