"""Candidate trajectories beside Frenetix, agreement first and then time: `python -m experiments.candidates`."""

from experiments.candidates.report import write
from experiments.candidates.study import CandidateStudy
from urbanjax.io.runs import cli

main = cli.experiment("candidates", CandidateStudy, anew=True)(write)

if __name__ == "__main__":
    main()
