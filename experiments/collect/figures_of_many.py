"""Scores over two axes, over many, and against each other."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.collect.axes import SweepAxis, shown
from experiments.collect.figures import FAINT, WIDTH, whiskers
from experiments.collect.known_scores import is_share
from experiments.collect.scores import Evidence, SweepScore
from experiments.collect.sweeps import SweepJob
from experiments.collect.ticks import marked, room_across
from urbanjax.evaluation.statistics import WithInterval
from urbanjax.io.figures.style import BAD, OTHER, figure

FEW_CELLS = 64  # of a heat map, which hold their number
ROWS = 12  # most labels up an axis of a heat map
PLAIN = 12  # names along an axis of parallel coordinates that are all written
COLOURS = "viridis"


def draw_grids(grids: Sequence[tuple[tuple[SweepAxis, SweepAxis], np.ndarray]], name: str, path: Path) -> None:
    """A heat map of a score for each pair of axes, all of one scale of colours.

    Args: grids, pairs and means [values of the first, values of the second]; name of the score; path of the picture.
    """
    across = min(len(grids), 2)
    down = -(-len(grids) // across)
    known = np.concatenate([np.ravel(found) for _, found in grids])
    low, high = np.nanmin(known), np.nanmax(known)
    with figure(path, WIDTH if across > 1 else 0.75 * WIDTH, height=3.2 * down) as canvas:
        panels = np.ravel(canvas.subplots(down, across, squeeze=False))
        shades = _shades(low, high, name)
        for axes, ((one, other), found) in zip(panels, grids, strict=False):
            axes.imshow(found, norm=shades.norm, cmap=shades.cmap, aspect="auto", origin="lower")
            for set_ticks, axis, room in ((axes.set_yticks, one, ROWS), (axes.set_xticks, other, room_across(other))):
                at = marked(axis, room)
                set_ticks(at, labels=[shown(axis.values[i]) for i in at])
            axes.set(xlabel=other.title, ylabel=one.title)
            axes.grid(visible=False)
            if found.size <= FEW_CELLS:
                _write_cells(axes, found, shades.norm, high - low)
        for axes in panels[len(grids) :]:
            axes.set_axis_off()
        canvas.colorbar(shades, ax=panels.tolist(), label=name, shrink=0.8)


def _shades(low: float, high: float, name: str) -> Any:
    """From a score to a colour; where all are equal, over a range around that which the score can have."""
    import matplotlib
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    if low == high:
        low, high = (0.0, 1.0) if is_share(name) else (low - (abs(low) or 1.0) / 2, low + (abs(low) or 1.0) / 2)
    return ScalarMappable(Normalize(low, high), matplotlib.colormaps[COLOURS])


def _write_cells(axes: Any, found: np.ndarray, shade: Any, span: float) -> None:
    digits = int(np.clip(1 - np.floor(np.log10(span)), 0, 4)) if span > 0 else 3
    for (i, j), value in np.ndenumerate(found):
        if np.isfinite(value):
            colour = "black" if shade(value) > 0.5 else "white"  # of the scale, whose upper half is bright
            axes.text(j, i, f"{value:.{digits}f}", ha="center", va="center", fontsize=7, color=colour)


def draw_parallel(
    axes_of: Sequence[SweepAxis], jobs: Sequence[SweepJob], score: np.ndarray, *, best: int, name: str, path: Path
) -> None:
    """Every job as a line across all axes, coloured by its score, the best one on top.

    Args: axes_of the sweep; jobs [N]; score [N]; best, which of them; name of the score; path of the picture.
    """
    shades = _shades(score.min(), score.max(), name)
    heights = np.stack([_height(axis, axis.positions(jobs)) for axis in axes_of], axis=1)
    with figure(path, max(WIDTH, 1.25 * len(axes_of) + 1.4), height=3.8) as canvas:
        panel = canvas.add_subplot()
        across = np.arange(len(axes_of))
        for i in np.argsort(score if score[best] == score.max() else -score):  # better ones over worse ones
            panel.plot(across, heights[i], color=shades.to_rgba(score[i]), lw=0.9, alpha=0.7)
        panel.plot(across, heights[best], "o-", color=BAD, lw=2.2, ms=5, label=f"best: {jobs[best].title}")
        for x, axis in enumerate(axes_of):
            panel.axvline(x, color=OTHER, lw=0.8, zorder=0)
            _write_scale(panel, x, axis)
        names = [f"{axis.title}{chr(10)}(log)" if axis.log else axis.title for axis in axes_of]
        panel.set_xticks(across, labels=names)
        panel.set(yticks=[], xlim=(-0.3, len(axes_of) - 0.4), ylim=(-0.06, 1.06))
        panel.spines[["left", "bottom"]].set_visible(False)
        panel.grid(visible=False)
        panel.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0))
        canvas.colorbar(shades, ax=panel, label=name, shrink=0.8)


def _height(axis: SweepAxis, at: np.ndarray) -> np.ndarray:
    """From 0 to 1 along an axis of parallel coordinates."""
    ends = np.array(axis.ends if axis.numeric else (0.0, len(axis.values) - 1), float)
    if axis.log:
        at, ends = np.log(at), np.log(ends)
    return (at - ends[0]) / (ends[1] - ends[0]) if ends[1] > ends[0] else np.full(len(at), 0.5)


def _write_scale(panel: Any, x: int, axis: SweepAxis) -> None:
    few = axis.values if len(axis.values) <= (5 if axis.numeric else PLAIN) else (axis.values[0], axis.values[-1])
    few = axis.ends if axis.numeric and axis.sampled else few
    at = np.array(few if axis.numeric else [axis.values.index(value) for value in few], float)
    for value, height in zip(few, _height(axis, at), strict=True):
        box = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.75}
        panel.text(x + 0.04, height, shown(value), fontsize=7, va="center", bbox=box, zorder=9)


def draw_front(
    jobs: Sequence[SweepJob], front: Sequence[SweepJob], evidence: Evidence, *, scores: Sequence[SweepScore], path: Path
) -> None:
    """Every job by two scores with intervals, and the front of those that no other beats in both.

    Jobs at one point are drawn once, with their number beside it.
    """
    told = {job.title: [evidence.of(job, score.name) for score in scores] for job in jobs}
    best = {job.title for job in front}
    with figure(path, 0.9 * WIDTH, height=4.4) as canvas:
        axes = canvas.add_subplot()
        for label, colour, alpha in (("jobs", OTHER, FAINT), ("on the front", BAD, 1.0)):
            part = [pair for title, pair in told.items() if (title in best) == (label == "on the front")]
            for number, (one, other) in enumerate(_points(part)):
                across = [[max(one.value - one.low, 0.0)], [max(one.high - one.value, 0.0)]]
                style = {"colour": colour, "line": "", "alpha": alpha, "label": "" if number else label}
                whiskers(axes, [one.value], [other], across=across, **style)
        for at, count in coinciding(list(told.values())).items():
            if count > 1:
                axes.annotate(f"{count} jobs", at, xytext=(4, 4), textcoords="offset points", fontsize=7, zorder=9)
        corners = np.array([[value.value for value in told[job.title]] for job in front])
        axes.step(*corners.T, where="post", color=BAD, lw=1.2)
        axes.set(xlabel=scores[0].told, ylabel=scores[1].told)
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)


def _points(pairs: Sequence[Sequence[WithInterval]]) -> list[Sequence[WithInterval]]:
    """The pairs of scores that are known, each point once."""
    return list({_at(pair): pair for pair in pairs if np.isfinite([value.value for value in pair]).all()}.values())


def coinciding(pairs: Sequence[Sequence[WithInterval]]) -> Counter[tuple[float, ...]]:
    """How many jobs there are at each point of two scores that are known. Args: pairs of scores, of each job."""
    return Counter(_at(pair) for pair in pairs if np.isfinite([value.value for value in pair]).all())


def _at(pair: Sequence[WithInterval]) -> tuple[float, ...]:
    """Where a job is, to rounding."""
    return tuple(float(f"{value.value:.9g}") for value in pair)
