"""How scores answer to axes: along one, over two, and what is best of two scores."""

from collections.abc import Sequence

import numpy as np

from experiments.collect.axes import SweepAxis, others, text_of
from experiments.collect.scores import Evidence, SweepScore
from experiments.collect.sweeps import SweepJob
from urbanjax.evaluation import statistics
from urbanjax.evaluation.statistics import WithInterval
from urbanjax.types import host_record

IN_BIN, BINS = 5, 8  # jobs that a mean needs at least, and most means along an axis


@host_record
class ResponsePoint:
    """What came out at one value of an axis, or around it."""

    value: object
    jobs: int
    score: WithInterval
    less_first: WithInterval  # paired difference to the first value
    pairs: int  # of drives


def along(
    axis: SweepAxis, axes: Sequence[SweepAxis], *, jobs: Sequence[SweepJob], evidence: Evidence, name: str
) -> list[ResponsePoint]:
    """The mean of a score at each value of an axis, over all else that was varied.

    Differences to the first value are of the same drives under the same values on all other axes.
    Args: axis; axes, all; jobs that are complete; evidence of them; name of the score.
    """
    groups = {
        text_of(value): [job for job in jobs if text_of(job.value(axis.key)) == text_of(value)] for value in axis.values
    }
    first, *_ = groups.values()
    at_first = {others(job, axis, axes): job for job in first}
    out = []
    for value, part in zip(axis.values, groups.values(), strict=True):
        alike = [(job, at_first[key]) for job in part if (key := others(job, axis, axes)) in at_first]
        less, pairs = evidence.difference(alike, name, axis=axis.key)
        known = sum(np.isfinite(evidence.of(job, name).value) for job in part)
        out.append(ResponsePoint(value, int(known), evidence.over(part, name), less, pairs))
    return out


def binned(axis: SweepAxis, jobs: Sequence[SweepJob], *, evidence: Evidence, name: str) -> list[ResponsePoint]:
    """The mean of a score over jobs in bins of as many along a sampled axis; with few jobs none.

    The interval is of jobs, each of which has other values on all other axes. Args: axis; jobs; evidence of them; name
    of the score.
    """
    at, value = axis.positions(jobs), np.array([evidence.of(job, name).value for job in jobs])
    at, value = at[np.isfinite(value)], value[np.isfinite(value)]
    count = min(BINS, len(value) // IN_BIN)
    if count < 2:
        return []
    nothing = WithInterval(np.nan, np.nan, np.nan)
    parts = np.array_split(np.argsort(at, kind="stable"), count)
    return [ResponsePoint(float(np.median(at[p])), len(p), statistics.mean(value[p]), nothing, 0) for p in parts]


def grid(pair: tuple[SweepAxis, SweepAxis], jobs: Sequence[SweepJob], *, evidence: Evidence, name: str) -> np.ndarray:
    """The mean of a score [values of the first axis, values of the second] over all else; NaN where no job has it.

    Args: pair of axes; jobs; evidence of them; name of the score.
    """
    cells: dict[tuple[str, str], list[SweepJob]] = {}
    for job in jobs:
        cells.setdefault((text_of(job.value(pair[0].key)), text_of(job.value(pair[1].key))), []).append(job)
    rows = [[cells.get((text_of(a), text_of(b)), []) for b in pair[1].values] for a in pair[0].values]
    return np.array([[evidence.over(part, name).value if part else np.nan for part in row] for row in rows])


def front(jobs: Sequence[SweepJob], evidence: Evidence, *, scores: Sequence[SweepScore]) -> list[SweepJob]:
    """The jobs than which no other is better in one score and as good in the other, from best to worst in the first.

    Args: jobs; evidence of them; scores, two.
    """
    at = np.array([[score.sign * evidence.of(job, score.name).value for score in scores] for job in jobs]).reshape(
        -1, 2
    )
    known = np.flatnonzero(np.isfinite(at).all(1))
    order = sorted(known.tolist(), key=lambda i: (-at[i, 0], -at[i, 1]))
    kept: list[int] = []
    for i in order:
        best = at[kept[-1]] if kept else None
        if best is None or at[i, 1] > best[1] or (at[i] == best).all():
            kept.append(i)
    return [jobs[i] for i in kept]


def nearest_defaults(
    jobs: Sequence[SweepJob], axes: Sequence[SweepAxis], *, defaults: dict[str, object]
) -> SweepJob | None:
    """The job whose values are nearest to those without overrides; the first one of several, None of none.

    Distances along an axis are shares of its range, and 1 for another text. Args: jobs; axes; defaults by key.
    """

    def distance(job: SweepJob) -> float:
        return float(sum(_apart(axis, job.value(axis.key), defaults.get(axis.key)) for axis in axes if axis.varies))

    return min(jobs, key=distance, default=None)


def _apart(axis: SweepAxis, one: object, other: object) -> float:
    if not axis.numeric or not isinstance(other, int | float) or (axis.log and other <= 0):
        return float(text_of(one) != text_of(other))
    ends = np.array([axis.values[0], axis.values[-1], one, other], float)
    ends = np.log(ends) if axis.log else ends
    return float(abs(ends[2] - ends[3]) / (ends[1] - ends[0]))
