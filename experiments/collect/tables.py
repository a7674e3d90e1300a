"""The jobs of sweeps as tables."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.collect.axes import SweepAxis, is_number, setting, shown
from experiments.collect.responses import ResponsePoint
from experiments.collect.scores import Evidence, SweepScore
from experiments.collect.sensitivity import AxisIndex
from experiments.collect.sweeps import SweepJob, SweepPlan
from urbanjax.evaluation.statistics import WithInterval
from urbanjax.io.runs.directory import COMPLETE

Columns = dict[str, list[Any]]
ABOUT = ("experiment", "sweep", "job", "status", "error")


def jobs_table(jobs: Sequence[SweepJob], keys: Sequence[str]) -> Columns:
    """One row for each planned job, from manifests alone.

    Args: jobs; keys that were varied, dotted. A key or an entry of summaries with the name of an earlier column has
    "override." or "summary." before its own.
    """
    several = len({job.experiment for job in jobs}) > 1
    out: Columns = {"experiment": [job.experiment for job in jobs]} if several else {}
    out |= {"sweep": [job.sweep for job in jobs], "job": [job.name for job in jobs]}
    out["status"] = [job.status for job in jobs]
    for key in keys:
        out[f"override.{key}" if key in ABOUT else key] = _alike([job.value(key) for job in jobs])
    for name in dict.fromkeys(name for job in jobs for name in job.summary):
        column = _alike([job.summary.get(name) for job in jobs])
        out[f"summary.{name}" if name in out or name in ABOUT else name] = column
    return out | {"error": [job.error for job in jobs]}


def _alike(values: list[Any]) -> list[Any]:
    """Values of one kind, as a column of Parquet has to hold: whole numbers, numbers, switches, or texts."""
    known = [value for value in values if value is not None]
    if all(isinstance(value, bool) for value in known) or all(_whole(value) for value in known):
        return values
    if all(is_number(value) or isinstance(value, float) for value in known):
        return [None if value is None else float(value) for value in values]
    return [
        value if value is None or isinstance(value, str) else json.dumps(value, ensure_ascii=False) for value in values
    ]


def _whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and abs(value) < 2**63


def unfinished(jobs: Sequence[SweepJob]) -> Columns:
    """The jobs that failed or are missing, and why."""
    left = [job for job in jobs if job.status != COMPLETE]
    return {
        "job": [job.title for job in left],
        "status": [job.status for job in left],
        "overrides": [_overrides(job) for job in left],
        "cause": [job.error for job in left],
    }


def _overrides(job: SweepJob) -> str:
    return ", ".join(f"{key}={shown(value)}" for key, value in job.overrides.items()) or "none"


def asked(plans: Sequence[SweepPlan], axes: Sequence[SweepAxis]) -> tuple[Columns, Columns]:
    """The sweeps, and the axes with all that they are. Args: plans; axes."""
    sweeps: Columns = {
        "sweep": [plan.name for plan in plans],
        "experiment": [plan.experiment for plan in plans],
        "jobs": [len(plan.jobs) for plan in plans],
        "sources (hash)": [plan.code[:12] or None for plan in plans],
        "command": [plan.command or None for plan in plans],
    }
    return sweeps, {
        "axis": [axis.label for axis in axes],
        "key": [axis.key for axis in axes],
        "kind": [axis.kind for axis in axes],
        "scale": ["logarithmic" if axis.log else "linear" if axis.numeric else "names" for axis in axes],
        "values": [len(axis.values) for axis in axes],
        "from, to, or which": [_extent(axis) for axis in axes],
        "unit": [axis.unit or None for axis in axes],
    }


def _extent(axis: SweepAxis) -> str:
    if axis.numeric and axis.varies:
        text = f"{shown(axis.ends[0])} to {shown(axis.ends[1])}"
        return text if axis.asked or not axis.sampled else f"{text} (those drawn)"
    return "; ".join(map(shown, axis.values[:8])) + ("; ..." if len(axis.values) > 8 else "")


def best_jobs(
    jobs: Sequence[SweepJob], axes: Sequence[SweepAxis], evidence: Evidence, scores: Sequence[SweepScore]
) -> Columns:
    """Jobs with their values and scores. Args: jobs in their order; axes; evidence; scores to be shown."""
    varied = [axis for axis in axes if axis.varies]
    out: Columns = {"job": [job.title for job in jobs]}
    out |= {axis.label: [shown(job.value(axis.key)) for job in jobs] for axis in varied}
    return out | {score.name: [text(evidence.of(job, score.name)) for job in jobs] for score in scores}


def response(points: Sequence[ResponsePoint], axis: SweepAxis, name: str) -> Columns:
    """A response as a table. Args: points; axis that they are on; name of the score."""
    return {
        axis.label: [shown(point.value) for point in points],
        "jobs": [point.jobs for point in points],
        name: [text(point.score) for point in points],
        f"less that of {shown(axis.values[0])}": [text(point.less_first) if point.pairs else None for point in points],
        "pairs of drives": [point.pairs for point in points],
    }


def sensitivity(indices: Sequence[AxisIndex]) -> Columns:
    """Indices as a table."""
    return {
        "axis": [index.axis.label for index in indices],
        "S1": [index.first_order.text(2) for index in indices],
        "delta": [index.delta.text(2) for index in indices],
    }


def differences(
    best: SweepJob,
    rest: Mapping[str, SweepJob],
    *,
    axes: Sequence[SweepAxis],
    evidence: Evidence,
    scores: Sequence[SweepScore],
) -> Columns:
    """The best job less others, drive by drive from the same starts. Args: best; rest by who they are; axes; ..."""
    out: Columns = {"the best job less": list(rest), "job": [job.title for job in rest.values()]}
    out["its values"] = [setting(job, axes) for job in rest.values()]
    key = [axis.key for axis in axes if axis.varies]
    for score in scores:
        found = [evidence.difference([(best, job)], score.name, axis=_apart(best, job, key)) for job in rest.values()]
        out[score.name] = [text(less) if pairs else None for less, pairs in found]
        out[f"pairs ({score.name})"] = [pairs for _, pairs in found]
    return out


def _apart(one: SweepJob, other: SweepJob, keys: Sequence[str]) -> str:
    """The key on which two jobs differ, where it is one alone; else none."""
    found = [key for key in keys if one.value(key) != other.value(key)]
    return found[0] if len(found) == 1 else ""


def text(value: WithInterval) -> str:
    """A number with its interval, in as many digits as the interval makes sense of."""
    if not np.isfinite(value.value):
        return "-"
    width = value.high - value.low if np.isfinite(value.high - value.low) else abs(value.value)
    size = width or abs(value.value)
    digits = 2 if not size else int(np.clip(2 - np.floor(np.log10(size)), 0, 4))
    return value.text(digits)
