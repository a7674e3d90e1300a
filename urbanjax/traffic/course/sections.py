"""Straights and curves of a course, proposed from the curvature of its reference line (Fig. 11). On the host."""

import itertools

import numpy as np

from urbanjax.traffic.course.areas import Areas, areas
from urbanjax.types import field, pytree, static
from urbanjax.types.errors import TrafficError


@pytree
class SectionParams:
    """What counts as a curve."""

    curvature: float = field(
        default=0.005, metadata={"range": (0.0, 10.0)}
    )  # 1/m, mean curvature beyond which a course curves
    # m over which curvature is averaged; a curve begins up to half of it early
    window: float = field(default=20.0, metadata={"range": (0.1, 1e4)})
    # m, a shorter section goes to the longer of its two neighbours
    shortest: float = field(default=30.0, metadata={"range": (0.1, 1e5)})
    spacing: float = field(default=1.0, metadata={"range": (0.01, 100.0)})  # m at which the line is looked at
    split: bool = static(default=True)  # a left and a right curve that follow each other are two


def sections(line: np.ndarray, params: SectionParams, *, closed: bool = True) -> Areas:
    """Areas `straight_1`, `curve_1`, ... that cover a reference line without gaps, in the order of their starts.

    The same line gives the same areas.
    Args: line [P, 2] m (host); closed, whether it goes on from its last point to its first, which is not repeated.
    Raises TrafficError for a line that is not finite, has no length, or is shorter than two sections.
    """
    points = np.asarray(line, float)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3 or not np.isfinite(points).all():
        raise TrafficError(f"reference line of shape {points.shape}: give at least three finite points [P, 2]")
    if closed:
        points = np.concatenate([points, points[:1]])
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    if length < 2 * max(params.shortest, params.window, params.spacing):
        raise TrafficError(f"reference line of {length:.1f} m: too short for two sections of {params.shortest} m")
    count = int(np.ceil(length / params.spacing))
    step = length / count
    kind = _kinds(_turning(points, count, step, closed, params), params)
    runs = _merged(_runs(kind, closed), params.shortest / step, closed)
    return _named(runs, step, count, length, closed)


def _turning(points: np.ndarray, count: int, step: float, closed: bool, params: SectionParams) -> np.ndarray:
    """Mean curvature [1/m] around each of the count cells of the line."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    even = np.stack([np.interp(step * np.arange(count + 1), along, c) for c in points.T], axis=1)
    chords = np.diff(even, axis=0)
    heading = np.unwrap(np.arctan2(chords[:, 1], chords[:, 0]))
    half = max(round(params.window / step / 2), 1)
    cells = np.arange(count)
    if closed:
        around = round((heading[-1] - heading[0]) / (2 * np.pi)) * 2 * np.pi
        whole = np.concatenate([heading - around, heading, heading + around])
        low, high = cells - half + count, cells + half + count
    else:
        whole, low, high = heading, np.maximum(cells - half, 0), np.minimum(cells + half, count - 1)
    return (whole[high] - whole[low]) / ((high - low) * step)


def _kinds(curvature: np.ndarray, params: SectionParams) -> list[int]:
    """0 for a straight cell; 1 for a curve, or -1 for a right one where they are told apart."""
    signed = np.where(np.abs(curvature) > params.curvature, np.sign(curvature), 0)
    return [int(k) for k in (signed if params.split else np.abs(signed))]


def _runs(kind: list[int], closed: bool) -> list[tuple[int, int, int]]:
    """(Kind, first cell, number of cells) of each run; on a closed line the last may go on over the start."""
    runs, first = [], 0
    for k, group in itertools.groupby(kind):
        size = len(list(group))
        runs.append((k, first, size))
        first += size
    if closed and len(runs) > 1 and runs[0][0] == runs[-1][0]:
        runs = [*runs[1:-1], (runs[-1][0], runs[-1][1], runs[-1][2] + runs[0][2])]
    return runs


def _merged(runs: list[tuple[int, int, int]], shortest: float, closed: bool) -> list[tuple[int, int, int]]:
    """The runs with each too short one, the shortest first, joined to the longer of its neighbours."""
    while len(runs) > 1 and min(size for _, _, size in runs) < shortest:
        i = min(range(len(runs)), key=lambda j: runs[j][2])
        # Turned so that the run and its neighbours are in a row.
        if closed:
            runs = runs[i - 1 :] + runs[: i - 1] if i else runs[-1:] + runs[:-1]
            i = 1
        beside = [j for j in (i - 1, (i + 1) % len(runs) if closed else i + 1) if 0 <= j < len(runs) and j != i]
        to = max(beside, key=lambda j: runs[j][2])
        low, high = (to, i) if (to == i - 1) else (i, to)
        joined = (runs[to][0], runs[low][1], runs[low][2] + runs[high][2])
        runs = [joined if j == low else run for j, run in enumerate(runs) if j != high]
        runs = _joined(runs, closed)
    return runs


def _joined(runs: list[tuple[int, int, int]], closed: bool) -> list[tuple[int, int, int]]:
    """The runs with neighbours of one kind as one."""
    found: list[tuple[int, int, int]] = []
    for kind, first, size in runs:
        if found and found[-1][0] == kind:
            found[-1] = (kind, found[-1][1], found[-1][2] + size)
        else:
            found.append((kind, first, size))
    if closed and len(found) > 1 and found[0][0] == found[-1][0]:
        found = [*found[1:-1], (found[-1][0], found[-1][1], found[-1][2] + found[0][2])]
    return found


def _named(runs: list[tuple[int, int, int]], step: float, count: int, length: float, closed: bool) -> Areas:
    if len(runs) == 1:
        return areas([("curve_1" if runs[0][0] else "straight_1", 0.0, length)], length)
    numbers = {"curve": 0, "straight": 0}
    rows = []
    for kind, first, size in sorted(runs, key=lambda run: run[1] % count):
        word = "curve" if kind else "straight"
        numbers[word] += 1
        end = first + size
        end = end - count if closed and end > count else end
        rows.append((f"{word}_{numbers[word]}", step * (first % count), min(step * end, length)))
    return areas(rows, length)
