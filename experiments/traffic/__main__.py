"""Traffic analysis of logs, as in Tables III to VII: `python -m experiments.traffic`.

Without files, of rollouts of the stack at several values of tau. `preset=f1_sakhir` and `preset=openacc` read the real
logs of the data folder, `preset=table3` explains the size of the paper's Table III.
"""

from experiments.traffic.report import write
from experiments.traffic.study import TrafficStudy
from urbanjax.io.runs import cli

main = cli.experiment("traffic", TrafficStudy)(write)

if __name__ == "__main__":
    main()
