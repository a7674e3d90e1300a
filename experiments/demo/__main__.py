"""Both studies at a size for a first look, in one self-contained report: `python -m experiments.demo` (`make demo`)."""

from experiments.demo.report import write
from experiments.demo.study import DemoStudy
from urbanjax.io.runs import cli

main = cli.experiment("demo", DemoStudy)(write)

if __name__ == "__main__":
    main()
