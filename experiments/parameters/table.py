"""The table of the continuous numbers of a closed loop."""

import itertools
import math
from collections.abc import Sequence
from typing import Any

from experiments.parameters.study import ParameterStudy
from urbanjax.io.runs import progress
from urbanjax.io.runs.directory import Run
from urbanjax.tuning import Trainable, trainables
from urbanjax.tuning.spaces import meant_by
from urbanjax.types import ConfigError
from urbanjax.types.limits import TINY


def write(params: ParameterStudy, run: Run) -> None:
    """Print the numbers that are asked for, group by group, and write them as one table into the run."""
    numbers = listed(params)
    run.table("parameters", columns(numbers))
    for group, held in itertools.groupby(numbers, key=lambda number: number.group):
        progress.show_table(group or "the loop", shown(list(held)), texts=("unit", "transform", "tuning"))
    tunable = sum(number.tunable for number in numbers)
    run.summary({"numbers": len(numbers), "tunable": tunable, "fixed": len(numbers) - tunable})
    print(f"{len(numbers)} numbers, {tunable} of them tunable")


def listed(params: ParameterStudy) -> list[Trainable]:
    """The numbers that are asked for, in their order.

    Args: params, the study. Raises ConfigError where there are none, with the nearest key or why they are fixed.
    """
    meant = meant_by(params.pattern, trainables(params.loop()))
    wanted = [number for number in meant if params.only in ("all", "tunable" if number.tunable else "fixed")]
    if not wanted:
        why = f", as '{meant[0].key}': {meant[0].pinned}" if meant[0].pinned else ""
        others = "fixed" if params.only == "tunable" else "tunable"
        raise ConfigError(f"'{params.pattern}' means no number that is {params.only}, all are {others}{why}")
    return wanted


def columns(numbers: Sequence[Trainable]) -> dict[str, list[Any]]:
    """All that is known of numbers, a column for each thing. Args: numbers, to be listed."""
    names = ("key", "value", "unit", "low", "high", "transform", "scale")
    known = {name: [getattr(number, name) for number in numbers] for name in names}
    return {**known, "tunable": [number.tunable for number in numbers], "why_fixed": [n.pinned for n in numbers]}


def shown(numbers: Sequence[Trainable]) -> dict[str, list[Any]]:
    """What a reader sees of the numbers of one group. Args: numbers, of the group."""
    return {
        "": [number.key.removeprefix(f"{number.group}.") for number in numbers],
        "value": [number.value for number in numbers],
        "unit": [number.unit for number in numbers],
        "low": ["> 0" if number.low == TINY else _bound(number.low) for number in numbers],
        "high": [_bound(number.high) for number in numbers],
        "transform": [number.transform if number.tunable else "" for number in numbers],
        "tuning": ["tunable" if number.tunable else f"fixed, {number.pinned}" for number in numbers],
    }


def _bound(value: float) -> float | None:
    return value if math.isfinite(value) else None
