"""Candidate trajectories beside Frenetix, agreement first and then time: `python -m experiments.candidates`."""

import json
import os
from importlib import metadata

from urbanjax.io import cli, progress
from urbanjax.io.runs import Run
from urbanjax.io.studies import candidates, candidates_figures, candidates_peer
from urbanjax.io.studies.candidates import CandidateStudy


@cli.experiment("candidates", CandidateStudy)
def main(params: CandidateStudy, run: Run) -> None:
    """Compare, time, draw, and write the numbers."""
    with progress.bar("candidates") as tick:
        numbers = candidates.measure(params, tick)
    run.summary(numbers | {"load_average": os.getloadavg()[0]})
    if candidates_peer.library() is None:
        print("The comparison is left out: frenetix is not installed (extra `peers`).")
    else:
        columns = candidates.agreement_table(numbers)
        run.table("agreement", columns)
        progress.show_table(f"Agreement with Frenetix {metadata.version('frenetix')}", columns)
        print("Rows with `true` compare true second derivatives; Frenetix 0.4.0 takes half of them, the others do too.")
    columns = candidates.times_table(numbers)
    run.table("times", columns)
    progress.show_table("Warm medians", columns)
    candidates_figures.draw_fan(params, run.path("candidates.png"))
    candidates_figures.draw_times(numbers, run.path("times.png"))
    facts = run.manifest()
    print(json.dumps({"device": facts["device"], "versions": facts["versions"]}))


if __name__ == "__main__":
    main()
