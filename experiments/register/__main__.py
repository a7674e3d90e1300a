"""The paper's Table I, a factorial study of its parameters, and the covariance: `python -m experiments.register`."""

from experiments.register.report import write
from experiments.register.study import RegisterStudy
from urbanjax.io.runs import cli

main = cli.experiment("register", RegisterStudy, anew=True)(write)

if __name__ == "__main__":
    main()
