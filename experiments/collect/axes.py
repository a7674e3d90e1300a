"""What was varied: by key, with a short name, its values and their scale."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.collect.sweeps import SweepJob, SweepPlan
from experiments.collect.units import NO_UNIT, known_numbers
from urbanjax.io.runs.processes import OWN
from urbanjax.types import host_record
from urbanjax.types.unread import changed

SAMPLED = ("sobol", "lhs")
APART = (*OWN, "worst", "logs", "dirs")  # they change no number
LONGEST, LONGEST_UNIT = 28, 16  # characters of a value, and of a unit, in a label


@host_record
class SweepAxis:
    """One key that differs between jobs."""

    key: str
    label: str  # the shortest end of the key that no other axis has
    kind: str
    values: tuple  # each once; numbers rise, all else is as it was planned
    numeric: bool
    log: bool  # evenly spaced in the logarithm
    asked: tuple[float, float] | None = None  # the range that its values were to be of, where the plan tells it
    bounds: tuple[float, float] = (-np.inf, np.inf)  # what it may be at all
    unit: str = ""  # where it has one that is known

    @property
    def title(self) -> str:
        """Its name with its unit, for an axis of a figure."""
        return f"{self.label} [{self.unit}]" if 0 < len(self.unit) <= LONGEST_UNIT else self.label

    @property
    def ends(self) -> tuple[float, float]:
        """From where to where it goes: the range asked for, else its least and greatest value."""
        low, high = self.asked or (self.values[0], self.values[-1])
        return float(low), float(high)

    @property
    def sampled(self) -> bool:
        """Whether its values were drawn, and not set."""
        return self.kind in SAMPLED

    @property
    def varies(self) -> bool:
        """Whether it has more than one value."""
        return len(self.values) > 1

    def positions(self, jobs: Sequence[SweepJob]) -> np.ndarray:
        """Where jobs [N] are on it: the number, or which of its values it is. Args: jobs."""
        if self.numeric:
            return np.array([job.value(self.key) for job in jobs], float)
        order = {text_of(value): i for i, value in enumerate(self.values)}
        return np.array([order[text_of(job.value(self.key))] for job in jobs], float)


def axes_of(plans: Sequence[SweepPlan], jobs: Sequence[SweepJob]) -> list[SweepAxis]:
    """Every axis of some sweeps of one experiment, and every key in which the sweeps themselves differ.

    Args: plans of them; jobs, all of theirs.
    """
    told: dict[str, dict[str, Any]] = {}
    for plan in plans:
        overridden = dict.fromkeys(key for job in plan.jobs for key in job.overrides)
        for key in [*plan.axes, *overridden]:
            axis = dict(plan.axes.get(key, {}))
            known = told.setdefault(key, axis)
            told[key] = _together(axis if axis.get("kind") in SAMPLED else known, [known, axis])
    for plan in plans[1:]:
        for key in changed(plan.config, plans[0].config):
            if key not in APART:
                told.setdefault(key, {"kind": "between sweeps"})
    labels = short_labels(list(told))
    return [_axis(key, axis, labels[key], jobs) for key, axis in told.items()]


def _together(axis: Mapping[str, Any], parts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """An axis of several sweeps: its range holds all of theirs, and is not known where that of one is not."""
    if not all(is_number(part.get(name)) for part in parts for name in ("low", "high")):
        return {name: value for name, value in axis.items() if name not in ("low", "high")}
    return {**axis, "low": min(part["low"] for part in parts), "high": max(part["high"] for part in parts)}


def _axis(key: str, axis: Mapping[str, Any], label: str, jobs: Sequence[SweepJob]) -> SweepAxis:
    held = {text_of(job.value(key)): job.value(key) for job in jobs}
    values = list(held.values())
    numeric = bool(values) and all(is_number(value) for value in values)
    if numeric:
        values = sorted(set(values))
    kind = str(axis.get("kind", "choice"))
    asked = _asked(axis, values, numeric)
    positive = numeric and min(values) > 0 and (asked is None or asked[0] > 0)
    log = positive and (kind == "logspace" or axis.get("log") is True or _geometric(values))
    known = known_numbers().get(key)
    about = {"bounds": (known.low, known.high), "unit": "" if known.unit == NO_UNIT else known.unit} if known else {}
    return SweepAxis(key, label, kind, tuple(values), numeric, bool(log), asked, **about)


def _asked(axis: Mapping[str, Any], values: Sequence[Any], numeric: bool) -> tuple[float, float] | None:
    """The range that a plan tells, where it holds all values: plans of before tell none."""
    if not (numeric and is_number(axis.get("low")) and is_number(axis.get("high"))):
        return None
    low, high = float(axis["low"]), float(axis["high"])
    # What is computed in the logarithm may end a rounding error past the range.
    slack = 1e-9 * max(abs(low), abs(high))
    return (low, high) if low - slack <= values[0] and values[-1] <= high + slack else None


def _geometric(values: Sequence[Any]) -> bool:
    """Whether three or more positive values have one ratio."""
    steps = np.diff(np.log(values)) if len(values) > 2 else np.zeros(0)
    return bool(steps.size and np.allclose(steps, steps[0], rtol=1e-6) and not np.allclose(np.diff(values, 2), 0))


def short_labels(keys: Sequence[str]) -> dict[str, str]:
    """The shortest end of each dotted key that no other one has. Args: keys, each once."""

    def ends(key: str, parts: int) -> str:
        return ".".join(key.split(".")[-parts:])

    found = {}
    for key in keys:
        lengths = range(1, key.count(".") + 2)
        alone = (n for n in lengths if not any(ends(other, n) == ends(key, n) for other in keys if other != key))
        found[key] = ends(key, next(alone, lengths[-1]))
    return found


def is_number(value: Any) -> bool:
    """Whether a plain value is a finite number, and no switch."""
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


def text_of(value: Any) -> str:
    """A plain value, the same for equal ones: what tells settings apart."""
    return repr(float(value)) if is_number(value) else json.dumps(value, sort_keys=True, ensure_ascii=False)


def shown(value: Any) -> str:
    """A plain value as a reader wants it: few digits, lists without brackets, no longer than a label may be."""
    if isinstance(value, list | tuple):
        text = ", ".join(map(shown, value)) or "none"
    else:
        text = f"{value:.4g}" if is_number(value) else "-" if value is None else str(value)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 1]}\u2026"


def setting(job: SweepJob, axes: Sequence[SweepAxis]) -> str:
    """The values of a job on some axes, for a table. Args: job; axes."""
    return ", ".join(f"{axis.label} = {shown(job.value(axis.key))}" for axis in axes if axis.varies) or "as planned"


def others(job: SweepJob, axis: SweepAxis, axes: Sequence[SweepAxis]) -> tuple[str, ...]:
    """What tells a job apart from those that differ on one axis alone. Args: job; axis, that one; axes, all."""
    return tuple(text_of(job.value(other.key)) for other in axes if other.key != axis.key)
