"""What there is of one experiment: its sweeps, jobs, axes and scores."""

import math
from collections.abc import Sequence

from experiments.collect.axes import SweepAxis
from experiments.collect.scores import SECOND, Evidence, SweepScore, chosen, ranked
from experiments.collect.study import CollectStudy
from experiments.collect.sweeps import SweepJob, SweepPlan
from urbanjax.io.runs.directory import COMPLETE
from urbanjax.types import host_record


@host_record
class Collected:
    """The sweeps of one experiment, read."""

    experiment: str
    prefix: str  # of its files, where there are several experiments
    plans: Sequence[SweepPlan]
    jobs: Sequence[SweepJob]  # each once
    axes: Sequence[SweepAxis]
    scores: Sequence[SweepScore]  # what is best, and what it is weighed against
    evidence: Evidence
    ranking: Sequence[SweepJob]  # those that have the first score, from best to worst

    @property
    def complete(self) -> list[SweepJob]:
        """The jobs that are complete."""
        return [job for job in self.jobs if job.status == COMPLETE]

    @property
    def varied(self) -> list[SweepAxis]:
        """The axes with more than one value."""
        return [axis for axis in self.axes if axis.varies]

    @property
    def tied(self) -> list[SweepJob]:
        """The best jobs: all that have the best value, to rounding."""
        value = [self.evidence.of(job, self.scores[0].name).value for job in self.ranking]
        return [job for job, each in zip(self.ranking, value, strict=True) if math.isclose(each, value[0])]

    def constant(self, name: str) -> bool:
        """Whether a score is known of several jobs and the same in all. Args: name of it."""
        value = [self.evidence.of(job, name).value for job in self.complete]
        value = [each for each in value if math.isfinite(each)]
        return len(value) > 1 and min(value) == max(value)

    @property
    def constants(self) -> list[str]:
        """The names of the scores that are the same in all jobs."""
        return [score.name for score in self.known if self.constant(score.name)]

    @property
    def known(self) -> list[SweepScore]:
        """The scores that some job has."""
        return [score for score in self.scores if ranked(self.complete, self.evidence, score)]


def collected(
    params: CollectStudy,
    plans: Sequence[SweepPlan],
    jobs: Sequence[SweepJob],
    axes: Sequence[SweepAxis],
    *,
    alone: bool,
) -> Collected:
    """Read what the jobs of one experiment found. Args: plans; jobs, each once; axes; alone, if no other is."""
    scores = chosen(params, jobs)
    evidence = Evidence(jobs, list(dict.fromkeys((*(score.name for score in scores), SECOND))))
    experiment = plans[0].experiment
    return Collected(
        experiment=experiment,
        prefix="" if alone else f"{experiment}_",
        plans=plans,
        jobs=jobs,
        axes=axes,
        scores=scores,
        evidence=evidence,
        ranking=ranked(jobs, evidence, scores[0]) if scores else [],
    )
