"""Closed loop in the place of every recorded driver: `python -m experiments.recorded`.

With `egos=problems` the planning problems of the CommonRoad files are driven instead.
"""

from experiments.recorded.report import SweptRecordings, write
from experiments.recorded.study import RecordedStudy
from urbanjax.io.runs import cli

main = cli.experiment("recorded", RecordedStudy, evaluation=SweptRecordings)(write)

if __name__ == "__main__":
    main()
