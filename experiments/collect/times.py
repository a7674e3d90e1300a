"""When the jobs of sweeps ran, which is not when their report was written."""

from collections.abc import Mapping, Sequence
from datetime import datetime

from experiments.collect.axes import is_number
from experiments.collect.sweeps import SweepJob

FORM = "%Y-%m-%dT%H:%M:%S%z"  # of a manifest
OF_THE_REPORT = {"started": "report begun", "wall time": "time to write it", "git commit": "git commit of the report"}
Spans = list[tuple[datetime, float]]


def facts(told: Mapping[str, str], *, jobs: Sequence[SweepJob]) -> dict[str, str]:
    """What a page says of a run, as said of a report, with the times of the jobs before it.

    Args: told, of the run, by name; jobs, of all sweeps.
    """
    return {**_of(spans(jobs), len(jobs)), **{OF_THE_REPORT.get(name, name): text for name, text in told.items()}}


def spans(jobs: Sequence[SweepJob]) -> Spans:
    """When jobs began and for how many seconds they ran, as far as their manifests tell it, in order. Args: jobs."""
    found = []
    for job in jobs:
        try:
            began = datetime.strptime(job.started or "", FORM)
        except (TypeError, ValueError):
            continue
        if is_number(job.wall_time_s):
            found.append((began, float(job.wall_time_s or 0.0)))
    return sorted(found)


def on_the_clock(found: Spans) -> float:
    """The seconds in which at least one job ran. Args: found, in order."""
    total, until = 0.0, -float("inf")
    for began, lasted in found:
        start, end = began.timestamp(), began.timestamp() + lasted
        total += max(end - max(start, until), 0.0)
        until = max(until, end)
    return total


def _of(found: Spans, count: int) -> dict[str, str]:
    if not found:
        return {}
    known = "" if len(found) == count else f" (known of {len(found)} of {count} jobs)"
    total = sum(lasted for _, lasted in found)
    wall = f"{on_the_clock(found):.0f} s on the clock; in sum, where jobs at once each count in full, {total:.0f} s"
    return {"first job started": found[0][0].strftime(FORM), "wall time of the jobs": f"{wall}{known}"}
