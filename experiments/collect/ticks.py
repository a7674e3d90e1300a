"""The axes of figures: names with units, and ticks that are plain numbers within what was asked."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from experiments.collect.axes import SweepAxis, shown

FEW = 12  # values that are marked on an axis one by one
CHARACTERS = 45  # of the font below half a page
STEPS = ((1, 3), (1, 2, 5), (1, 1.5, 2, 3, 5, 7))  # within a decade, from coarse to fine
FEWEST, MOST = 3, 7  # ticks of a logarithmic axis


def scale(panels: Sequence[Any], axis: SweepAxis) -> None:
    """The horizontal axis that panels share: its name below the last, its scale, its values where they are few.

    Args: panels, from above; axis.
    """
    at: Sequence[Any] | None = None
    if not axis.sampled and len(axis.values) <= FEW and _apart(axis):
        at = axis.values
    elif axis.log:
        at = log_ticks(*axis.ends)
    for panel in panels:
        if axis.log:
            panel.set_xscale("log")
        if at is not None:
            panel.set_xticks(at, labels=[shown(value) for value in at])
        panel.minorticks_off()
    panels[-1].set_xlabel(axis.title)


def log_ticks(low: float, high: float) -> list[float]:
    """Round numbers from low to high that are evenly spaced in the logarithm, few enough to stand apart.

    Args: low, high, both positive.
    """
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    within = (low * (1 - 1e-9), high * (1 + 1e-9))
    for steps in STEPS:
        found = [float(f"{step}e{k}") for k in decades for step in steps]
        found = [value for value in found if within[0] <= value <= within[1]]
        if len(found) >= FEWEST:
            return _thinned(found)
    return [low, high] if high > low else [low]


def _thinned(found: list[float]) -> list[float]:
    """Powers of ten alone, or every second of them and so on, where there are too many."""
    if len(found) <= MOST:
        return found
    tens = [value for value in found if math.isclose(math.log10(value), round(math.log10(value)), abs_tol=1e-9)]
    return tens[:: -(-len(tens) // MOST)]


def marked(axis: SweepAxis, room: int) -> range:
    """Which of an axis's values are labelled, at even steps: all, where there is room. Args: axis; room for so many."""
    return range(0, len(axis.values), max(1, -(-len(axis.values) // room)))


def room_across(axis: SweepAxis) -> int:
    """How many labels of an axis stand side by side below half a page. Args: axis."""
    return max(1, int(CHARACTERS / (max(len(shown(value)) for value in axis.values) + 1.5)))


def _apart(axis: SweepAxis) -> bool:
    """Whether the labels of all values find room in half a page."""
    at = np.log(axis.values) if axis.log else np.asarray(axis.values, float)
    longest = max(len(shown(value)) for value in axis.values)
    return len(at) < 2 or bool(np.diff(at).min() / (at[-1] - at[0]) > (longest + 1.5) / CHARACTERS)
