"""Scores along one axis, and what decides them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.collect.axes import SweepAxis, shown
from experiments.collect.known_scores import is_share
from experiments.collect.responses import ResponsePoint
from experiments.collect.sensitivity import AxisIndex
from experiments.collect.ticks import scale
from urbanjax.evaluation.statistics import WithInterval
from urbanjax.io.figures.style import BAD, GOOD, OTHER, figure

WIDTH = 7.4  # inch, of a page that is also read on a phone
PANEL = 2.5  # inch high
FAINT = 0.45  # of what lies behind
Responses = Mapping[str, Sequence[ResponsePoint]]  # by name of the score


def draw_response(axis: SweepAxis, found: Responses, path: Path) -> None:
    """Each score along a numeric axis, and its paired difference to the first value where there are pairs."""
    paired = any(point.pairs for points in found.values() for point in points)
    with figure(path, WIDTH if paired else 0.75 * WIDTH, height=PANEL * len(found) + 0.3) as canvas:
        panels = canvas.subplots(len(found), 1 + paired, squeeze=False, sharex=True)
        for row, (name, points) in zip(panels, found.items(), strict=True):
            at = [point.value for point in points]
            whiskers(row[0], at, [point.score for point in points], colour=GOOD, line="-")
            row[0].set_ylabel(name)
            if paired:
                whiskers(row[1], at[1:], [point.less_first for point in points[1:]], colour=BAD, line="-")
                row[1].plot(at[:1], [0.0], "o", ms=4, color=OTHER)
                row[1].axhline(0.0, color=OTHER, lw=0.8)
        panels[0, 0].set_title("mean")
        if paired:
            panels[0, 1].set_title(f"less that at {axis.label} = {shown(axis.values[0])}, same drives")
        for column in panels.T:
            scale(list(column), axis)


def draw_sample(
    axis: SweepAxis, jobs: Mapping[str, tuple[Any, Sequence[WithInterval]]], means: Responses, path: Path
) -> None:
    """Every job along a sampled axis as a point, and the means of bins with their intervals.

    Jobs that drive from the same starts share most of their error: their intervals would hide the trend.
    Args: axis; jobs: positions and scores of all, by name of the score; means likewise; path of the picture.
    """
    with figure(path, 0.85 * WIDTH, height=PANEL * len(jobs) + 0.3) as canvas:
        panels = np.ravel(canvas.subplots(len(jobs), 1, squeeze=False, sharex=True))
        for axes, (name, (at, scores)) in zip(panels, jobs.items(), strict=True):
            axes.plot(at, [score.value for score in scores], "o", ms=3.5, color=OTHER, alpha=FAINT, label="jobs")
            points = means.get(name, ())
            if points:
                mean = [point.score for point in points]
                whiskers(axes, [point.value for point in points], mean, colour=BAD, line="-", label="means of bins")
            axes.set_ylabel(name)
            if is_share(name) and len({score.value for score in scores}) == 1:
                axes.set_ylim(-0.04, 1.04)  # else around the one value, and so past what it can be
        if any(means.values()):
            panels[0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
        scale(list(panels), axis)


def draw_names(axis: SweepAxis, found: Responses, path: Path) -> None:
    """Each score by name of what was chosen on an axis."""
    labels = [shown(value) for value in axis.values]
    width = min(WIDTH, 2.2 + 2.6 * len(found))
    with figure(path, width, height=1.1 + 0.32 * len(labels)) as canvas:
        panels = np.ravel(canvas.subplots(1, len(found), squeeze=False, sharey=True))
        for axes, (name, points) in zip(panels, found.items(), strict=True):
            value, low, high = _ends([point.score for point in points])
            rows = np.arange(len(labels))
            axes.barh(rows, np.nan_to_num(value), height=0.6, color=GOOD, alpha=0.35)
            axes.errorbar(value, rows, xerr=np.stack([low, high]), fmt="o", ms=4, color=GOOD, lw=1.2, capsize=2)
            axes.set(xlabel=name, yticks=rows, yticklabels=labels)
        panels[0].invert_yaxis()
        panels[0].set_title(axis.title)


def draw_sensitivity(found: Mapping[str, Sequence[AxisIndex]], path: Path) -> None:
    """Both indices of every axis, for each score. Args: found, by name of the score; path of the picture."""
    longest = max(len(indices) for indices in found.values())
    with figure(path, WIDTH if len(found) > 1 else 0.6 * WIDTH, height=1.5 + 0.42 * longest) as canvas:
        panels = np.ravel(canvas.subplots(1, len(found), squeeze=False))
        for axes, (name, indices) in zip(panels, found.items(), strict=True):
            rows = np.arange(len(indices))
            for shift, kind, label, colour in ((-0.17, "first_order", "S1", GOOD), (0.17, "delta", "delta", BAD)):
                value, low, high = _ends([getattr(index, kind) for index in indices])
                reach = np.stack([low, high])
                axes.barh(rows + shift, np.nan_to_num(value), height=0.32, color=colour, alpha=0.4, label=label)
                axes.errorbar(value, rows + shift, xerr=reach, fmt="none", color=colour, lw=1.2, capsize=2)
            axes.set(yticks=rows, yticklabels=[index.axis.label for index in indices], title=name)
            axes.set(xlim=(0.0, 1.0), xlabel="index, 0 to 1")
            axes.invert_yaxis()
        panels[0].legend(loc="upper left", bbox_to_anchor=(0.0, -0.3), ncols=2)


def whiskers(
    axes: Any,
    at: Any,
    scores: Sequence[WithInterval],
    *,
    colour: str,
    line: str,
    across: Any = None,
    label: str = "",
    alpha: float = 1.0,
) -> None:
    """Numbers with their intervals.

    Args: axes; at, where; scores; colour; line between them; across, how far intervals of `at` reach; label; alpha.
    """
    value, low, high = _ends(scores)
    known = np.isfinite(value)
    where, reach = np.asarray(at, float)[known], np.stack([low, high])[:, known]
    beside = None if across is None else np.nan_to_num(np.asarray(across, float))[:, known]
    style = {"fmt": f"o{line}", "ms": 3.5, "color": colour, "elinewidth": 1.0, "capsize": 2}
    axes.errorbar(where, value[known], yerr=reach, xerr=beside, label=label or None, alpha=alpha, **style)


def _ends(scores: Sequence[WithInterval]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values, and how far their intervals reach below and above; 0 where there is no interval."""
    value, low, high = np.array(scores, float).reshape(-1, 3).T
    return value, np.nan_to_num(np.maximum(value - low, 0)), np.nan_to_num(np.maximum(high - value, 0))
