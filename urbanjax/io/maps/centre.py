"""Centre lines from the borders of lanes, and borders from centre lines (host side, float64)."""

import numpy as np

from urbanjax.io.maps.road import MapLane
from urbanjax.roadmap.builders.curves import normal
from urbanjax.types import host_record

KNOTS = 2.0  # m, between the points through which a link's centre line is drawn
TINY = 1e-9  # m, keeps directions of steps without length finite
SHORTEST = 0.1  # m, lanes below have no direction
NARROWEST, WIDEST = 0.1, 50.0  # m


@host_record
class CentreLine:
    """A lane's centre line through points at most 2 m apart."""

    centre: np.ndarray  # [n, 2] m
    heading: np.ndarray  # [n] rad, unwrapped
    width: np.ndarray  # [n] m, across the heading
    length: float  # m


def centre_line(lane: MapLane) -> CentreLine:
    """The middle of a lane's borders, evenly spaced, with headings that follow it smoothly.

    Args: lane, as the map states it.
    """
    left, right = (_forward(border) if lane.drawn else border for border in (lane.left, lane.right))
    if not (lane.paired and len(left) == len(right)):
        left, right = _paired(left, right)
    middle = 0.5 * (left + right)
    station = stations(middle)
    length = float(station[-1])
    grid = np.linspace(0.0, length, max(int(np.ceil(length / KNOTS)), 3) + 1)
    keep = np.concatenate([[True], np.diff(station) > 0])

    def at(points: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(grid, station[keep], points[keep, k]) for k in range(2)], -1)

    centre, across = at(middle), at(left - right)
    if length < SHORTEST:
        return CentreLine(centre, np.zeros(len(grid)), np.full(len(grid), NARROWEST), length)
    chords = np.diff(centre, axis=0)
    chord = np.unwrap(np.arctan2(chords[:, 1], chords[:, 0]))
    between = 0.5 * (chord[1:] + chord[:-1])
    heading = np.concatenate([[2 * chord[0] - between[0]], between, [2 * chord[-1] - between[-1]]])
    width = np.clip(np.abs((across * normal(heading)).sum(-1)), NARROWEST, WIDEST)
    return CentreLine(centre, heading, width, length)


def stations(points: np.ndarray) -> np.ndarray:
    """Arc length [n] m along a polyline [n, 2].

    Args: points [n, 2] m.
    """
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])


def borders(centre: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Left and right border [n, 2] of a lane that a map states by its centre line [n, 2] and its width [m].

    Args: centre [n, 2] m; width [m].
    """
    step = np.diff(centre, axis=0)
    unit = step / np.maximum(np.hypot(*step.T), TINY)[:, None]
    along = np.concatenate([unit[:1], unit[1:] + unit[:-1], unit[-1:]])
    along = along / np.maximum(np.hypot(*along.T), TINY)[:, None]
    aside = 0.5 * width * np.stack([-along[:, 1], along[:, 0]], -1)
    return centre + aside, centre - aside


def _forward(points: np.ndarray) -> np.ndarray:
    """A border without the points to which it only steps back, as where two points are in the wrong order."""
    step = np.diff(points, axis=0)
    back = (step[1:] * step[:-1]).sum(-1) < -0.5 * np.hypot(*step[1:].T) * np.hypot(*step[:-1].T)
    # A step back between two turns by more than 120 degrees; a hairpin has one.
    drop = np.flatnonzero(back[1:] & back[:-1]) + 2
    return np.delete(points, drop, axis=0)


def _paired(left: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both borders at the same shares of their lengths, with the points of both."""
    along = [stations(border) for border in (left, right)]
    shares = [s / s[-1] if s[-1] > 0 else np.linspace(0.0, 1.0, len(s)) for s in along]
    share = np.union1d(*shares)
    out = []
    for border, own in zip((left, right), shares, strict=True):
        out.append(np.stack([np.interp(share, own, border[:, k]) for k in range(2)], -1))
    return out[0], out[1]
