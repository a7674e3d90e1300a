"""What a builder or a map reader states of each lane, checked and resampled (host side, float64)."""

from collections.abc import Hashable, Sequence
from typing import Any

import numpy as np

from urbanjax.roadmap.builders.curves import hermite, normal
from urbanjax.roadmap.graph import RoadType, Rule, Turn
from urbanjax.types import RoadError, host_record

APART = 1e-6  # m, between points of a centre line that count as two
SHORTEST = 0.01  # m, of a lane


@host_record
class RoadStyle:
    """What the lanes of a made-up road have in common."""

    lane_width: float = 3.5  # m
    speed_limit: float = 50 / 3.6  # m/s
    section: float = np.inf  # m, the largest length of a link
    n_points: int = 32  # per link


@host_record
class LaneSpec:
    """One lane as a builder or a map reader states it; `assemble` derives everything else."""

    key: Any  # hashable; names the lane for `successors`, `left` and `right`
    centre: np.ndarray  # [n, 2] m, map coordinates, in driving direction
    heading: np.ndarray | None = None  # [n] rad, tangents of the centre line; without them it is a polyline
    width: float | np.ndarray = 3.5  # m, or [n] m beside the centre points; ignored where borders are given
    borders: tuple[np.ndarray, np.ndarray] | None = None  # left [m, 2] and right [k, 2] border, m
    speed_limit: float = 50 / 3.6  # m/s
    turn: Turn = Turn.STRAIGHT
    road_type: RoadType | None = RoadType.URBAN  # None: of a junction where the lane crosses another, urban elsewhere
    rule: Rule = Rule.NONE
    signals: tuple[tuple[int, float | None], ...] = ()  # signal id, station of its stop line (None: the lane's end)
    area: str = ""
    successors: tuple[Hashable, ...] = ()
    left: Hashable | None = None  # neighbour in the same direction
    left_change: bool | None = None  # None: where there is a neighbour. Without one, True: may use the oncoming lane
    right: Hashable | None = None
    right_change: bool | None = None  # None: where there is a neighbour


def check(specs: Sequence[LaneSpec], n_points: int) -> dict[Hashable, int]:
    """Index of each key, after the checks that need no geometry. Args: specs, the lanes; n_points, per link."""
    if not specs:
        raise RoadError("the road network is empty: give at least one lane")
    if n_points < 4:
        raise RoadError(f"n_points is {n_points}: use 4 or more")
    index = {spec.key: i for i, spec in enumerate(specs)}
    if len(index) < len(specs):
        twice = next(spec.key for i, spec in enumerate(specs) if index[spec.key] != i)
        raise RoadError(f"lane key {twice!r} is used twice: keys must differ")
    for spec in specs:
        centre = np.asarray(spec.centre)
        if centre.ndim != 2 or centre.shape[1] != 2 or len(centre) < 2:
            raise RoadError(f"lane {spec.key!r}: centre has shape {centre.shape}, expected [n, 2] with n >= 2")
        beside = [spec.width] if spec.heading is None else [spec.width, spec.heading]
        for array in [centre, *beside, spec.speed_limit, *(spec.borders or ())]:
            if not np.all(np.isfinite(np.asarray(array, float))):
                raise RoadError(f"lane {spec.key!r}: geometry, width or speed limit is not finite")
        if any(np.ndim(array) and np.shape(array) != (len(centre),) for array in beside):
            raise RoadError(f"lane {spec.key!r}: width or heading does not match its {len(centre)} centre points")
        if np.any(np.asarray(spec.width) <= 0):
            raise RoadError(f"lane {spec.key!r}: width must be positive")
        if spec.speed_limit <= 0:
            raise RoadError(f"lane {spec.key!r}: speed limit must be positive")
        named = [*spec.successors, *(key for key in (spec.left, spec.right) if key is not None)]
        unknown = [key for key in named if key not in index]
        if unknown:
            raise RoadError(f"lane {spec.key!r} names the unknown lane {unknown[0]!r}: add it or drop the reference")
    return index


def resample(spec: LaneSpec, n: int) -> tuple[np.ndarray, ...]:
    """Centre, left, right [n, 2], heading, curvature [n] and length of one lane at uniform arc length.

    Args: spec, a lane; n, number of points.
    """
    centre = np.asarray(spec.centre, float)
    chords = np.linalg.norm(np.diff(centre, axis=0), axis=-1)
    keep = np.concatenate([[True], chords > APART])
    width = np.broadcast_to(np.asarray(spec.width, float), len(centre))[keep]
    centre = centre[keep]
    if len(centre) < 2 or np.linalg.norm(np.diff(centre, axis=0), axis=-1).sum() < SHORTEST:
        raise RoadError(f"lane {spec.key!r} has no length: give it at least two distinct points")
    chords = np.linalg.norm(np.diff(centre, axis=0), axis=-1)
    given = None if spec.heading is None else np.unwrap(np.asarray(spec.heading, float)[keep])
    steps = chords if given is None else chords / np.sinc(np.diff(given) / (2 * np.pi))
    station = np.concatenate([[0.0], np.cumsum(steps)])
    grid = np.linspace(0.0, station[-1], n)
    if given is None:
        points = np.stack([np.interp(grid, station, centre[:, k]) for k in range(2)], -1)
        heading = _headings(points)
    else:
        i = np.clip(np.searchsorted(station, grid, side="right") - 1, 0, len(steps) - 1)
        points = hermite(centre, given, step=steps[i], index=i, along=grid - station[i])
        heading = np.interp(grid, station, given)
    curvature = np.gradient(heading, grid, edge_order=2)
    if spec.borders is None:
        half = 0.5 * np.interp(grid, station, width)[:, None] * normal(heading)
        left, right = points + half, points - half
    else:
        left, right = (_uniform(np.asarray(border, float), n, spec) for border in spec.borders)
    return points, left, right, heading, curvature, np.asarray(station[-1])


def _headings(points: np.ndarray) -> np.ndarray:
    """Tangent headings [n], unwrapped, exact where the points lie uniformly on a line or an arc."""
    chords = np.diff(points, axis=0)
    chord = np.unwrap(np.arctan2(chords[:, 1], chords[:, 0]))
    middle = 0.5 * (chord[1:] + chord[:-1])
    return np.concatenate([[2 * chord[0] - middle[0]], middle, [2 * chord[-1] - middle[-1]]])


def _uniform(border: np.ndarray, n: int, spec: LaneSpec) -> np.ndarray:
    """The border [n, 2] at uniform arc length."""
    if border.ndim != 2 or border.shape[1] != 2 or len(border) < 2:
        raise RoadError(f"lane {spec.key!r}: a border has shape {border.shape}, expected [n, 2] with n >= 2")
    station = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(border, axis=0), axis=-1))])
    grid = np.linspace(0.0, station[-1], n)
    return np.stack([np.interp(grid, station, border[:, k]) for k in range(2)], -1)
