"""Localization over the whole district (Table II), under injected failures, or on a folder of real scans.

`python -m experiments.localize`; `python -m experiments.localize folder=path/to/scans poses=path/to/poses.txt`.
"""

from experiments.localize.report import write
from experiments.localize.study import LocalizeStudy
from urbanjax.io.runs import cli

main = cli.experiment("localize", LocalizeStudy)(write)

if __name__ == "__main__":
    main()
