"""Candidate trajectories beside Frenetix, agreement first and then time."""

import json
import os
from importlib import metadata

from experiments.candidates import figures, peer
from experiments.candidates import study as candidates
from experiments.candidates.study import CandidateStudy
from urbanjax.io.runs import progress
from urbanjax.io.runs.directory import Run


def write(params: CandidateStudy, run: Run) -> None:
    """Compare, time, draw, and write the numbers."""
    with progress.bar("candidates") as tick:
        numbers = candidates.measure(params, tick)
    run.summary(numbers | {"load_average": os.getloadavg()[0]})
    if peer.library() is None:
        print("The comparison is left out: frenetix is not installed (extra `peers`).")
    else:
        columns = candidates.agreement_table(numbers)
        run.table("agreement", columns)
        progress.show_table(f"Agreement with Frenetix {metadata.version('frenetix')}", columns)
        print("Rows with `true` compare true second derivatives; Frenetix 0.4.0 takes half of them, the others do too.")
    columns = candidates.times_table(numbers)
    run.table("times", columns)
    progress.show_table("Warm medians", columns)
    figures.draw_fan(params, run.path("candidates.png"))
    figures.draw_times(numbers, run.path("times.png"))
    facts = run.manifest()
    print(json.dumps({"device": facts["device"], "versions": facts["versions"]}))
