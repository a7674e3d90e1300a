"""From a list of lanes to a road graph (host side, float64 until the end)."""

from collections.abc import Hashable, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

from urbanjax.roadmap.builders.relations import conflicts, crossing, meetings, neighbour_stations, opposites, pieces
from urbanjax.roadmap.builders.specs import LaneSpec, check, resample
from urbanjax.roadmap.graph import RoadGraph, RoadType
from urbanjax.roadmap.padding import GraphSize, pad
from urbanjax.types import RoadError

FAR = 20_000.0  # m from the origin beyond which float32 coordinates lose more than a millimetre
CROSSING = np.radians(15.0)  # angle from which lanes cross rather than part
ROUNDING = 1e-6  # m, by which a stop line may lie beyond its link
AT_ONCE = 256  # pairs of lanes, held against each other point by point


def assemble(
    specs: Sequence[LaneSpec],
    n_points: int = 32,
    *,
    origin: tuple[float, float] | None = None,
    size: GraphSize = GraphSize(),  # noqa: B008 (frozen)
    n_signals: int | None = None,
    gap_tolerance: float = 2.0,
) -> RoadGraph:
    """The road graph of the lanes; link i is specs[i].

    Derives predecessors, station maps between neighbours, opposite lanes and conflicts. Every link is resampled to
    `n_points` at uniform arc length, so that `station[l, p] = length[l] * p / (n_points - 1)`.
    Args: specs, the lanes; n_points, per link; origin m, map coordinates of the graph's (0, 0) (None: the map's own, or
    the centre of the lanes where they lie more than 20 km from it); size, to pad to; n_signals, number of signals
    (None: the largest id and one); gap_tolerance m, the largest distance from a lane's end to its successor's start.
    Raises RoadError on an empty or inconsistent network, with the lane's key.
    """
    index = check(specs, n_points)
    rows = [resample(spec, n_points) for spec in specs]
    centre, left, right, heading, curvature, length = (np.stack(column) for column in zip(*rows, strict=True))
    width = np.linalg.norm(left - right, axis=-1).mean(-1)
    successors, predecessors = _succession(specs, index, centre, gap_tolerance)
    neighbour = _neighbours(specs, index)
    at = _origin(centre, origin)
    found = meetings(pieces(centre - at, heading, width=width, length=length), width, length=length)
    opposite = opposites(found, width, length=length)
    conflict = conflicts(found, width, related=_related(successors, neighbour, opposite))
    signals = _signals(specs, length)
    areas = list(dict.fromkeys(["", *(spec.area for spec in specs)]))

    n_s, n_x, n_y = (
        max(1, *(len(row) for row in rows)) for rows in ([*successors, *predecessors], [*opposite, *conflict], signals)
    )
    successor, has_successor = _table(successors, n_s)
    predecessor, has_predecessor = _table(predecessors, n_s)
    opposite_link, has_opposite = _table([[j for j, _ in row] for row in opposite], n_x)
    conflict_link, has_conflict = _table(conflict, n_x)
    signal, has_signal = _table([[g for g, _ in row] for row in signals], n_y)
    graph = RoadGraph(
        centre=_floats(centre - at),
        left=_floats(left - at),
        right=_floats(right - at),
        heading=_floats(heading),
        curvature=_floats(curvature),
        station=_floats(length[:, None] * np.linspace(0.0, 1.0, n_points)),
        length=_floats(length),
        speed_limit=_floats([spec.speed_limit for spec in specs]),
        turn=_integers([int(spec.turn) for spec in specs]),
        road_type=_integers(_road_types(specs, centre - at, conflict)),
        rule=_integers([int(spec.rule) for spec in specs]),
        valid=jnp.asarray(np.ones(len(specs), bool)),
        successor=successor,
        has_successor=has_successor,
        predecessor=predecessor,
        has_predecessor=has_predecessor,
        **_sides(specs, neighbour, centre, heading, length),
        opposite=opposite_link,
        has_opposite=has_opposite,
        opposite_offset=_floats(_ragged([[x for _, x in row] for row in opposite], n_x)),
        conflict=conflict_link,
        has_conflict=has_conflict,
        signal=signal,
        has_signal=has_signal,
        stop_line=_floats(_ragged([[s for _, s in row] for row in signals], n_y)),
        area=_integers([areas.index(spec.area) for spec in specs]),
        origin=(float(at[0]), float(at[1])),
        area_names=tuple(areas),
        n_signals=_count(signals, n_signals),
    )
    return pad(graph, size)


def _floats(x: Any) -> Array:
    return jnp.asarray(x, jnp.zeros(()).dtype)


def _integers(x: Any) -> Array:
    return jnp.asarray(np.asarray(x), jnp.int32)


def _table(rows: list[list[int]], width: int) -> tuple[Array, Array]:
    """Indices [L, width] and their mask, from ragged rows."""
    return _integers(_ragged(rows, width)), jnp.asarray(_ragged([[1] * len(row) for row in rows], width) > 0)


def _ragged(rows: list[list[Any]], width: int) -> np.ndarray:
    out = np.zeros((len(rows), width))
    for i, row in enumerate(rows):
        out[i, : len(row)] = row
    return out


def _succession(
    specs: Sequence[LaneSpec], index: dict[Hashable, int], centre: np.ndarray, gap_tolerance: float
) -> tuple[list[list[int]], list[list[int]]]:
    """Successors and predecessors of each link."""
    successors = [[index[key] for key in spec.successors] for spec in specs]
    predecessors: list[list[int]] = [[] for _ in specs]
    for i, following in enumerate(successors):
        for j in following:
            gap = np.linalg.norm(centre[i, -1] - centre[j, 0])
            if gap > gap_tolerance:
                raise RoadError(
                    f"lane {specs[i].key!r} ends {gap:.1f} m from the start of its successor {specs[j].key!r}: "
                    "connect them or raise gap_tolerance"
                )
            predecessors[j].append(i)
    return successors, predecessors


def _sides(
    specs: Sequence[LaneSpec],
    neighbour: dict[str, np.ndarray],
    centre: np.ndarray,
    heading: np.ndarray,
    length: np.ndarray,
) -> dict[str, Array]:
    """The graph's fields about left and right neighbours."""
    out = {}
    for side, link in neighbour.items():
        stated = [getattr(spec, f"{side}_change") for spec in specs]
        beside = np.where(link < 0, np.arange(len(specs)), link)
        out[f"{side}_link"] = _integers(np.maximum(link, 0))
        out[f"has_{side}"] = jnp.asarray(link >= 0)
        out[f"{side}_change"] = jnp.asarray(
            [bool(j >= 0 if s is None else s) for s, j in zip(stated, link, strict=True)]
        )
        out[f"{side}_station"] = _floats(neighbour_stations(centre, heading, length=length, other=beside))
    return out


def _related(
    successors: list[list[int]], neighbour: dict[str, np.ndarray], opposite: list[list[tuple[int, float]]]
) -> set[tuple[int, int]]:
    """Pairs whose nearness is no conflict: in succession, from a common link, side by side, opposed."""
    related = {(i, j) for i, following in enumerate(successors) for j in following}
    related |= {(i, j) for following in successors for i in following for j in following}
    related |= {(i, int(j)) for side in neighbour.values() for i, j in enumerate(side) if j >= 0}
    return related | {(i, j) for i, row in enumerate(opposite) for j, _ in row}


def _road_types(specs: Sequence[LaneSpec], centre: np.ndarray, conflict: list[list[int]]) -> list[int]:
    """The road type of each link; where a lane states none, that of a junction if it crosses another lane."""
    pairs = [(i, j) for i, row in enumerate(conflict) if specs[i].road_type is None for j in row]
    crosses = np.zeros(len(specs), bool)
    for part in np.array_split(np.array(pairs, int).reshape(-1, 2), max(1, -(-len(pairs) // AT_ONCE))):
        crosses[part[:, 0]] |= crossing(centre[part[:, 0]], centre[part[:, 1]], least_angle=CROSSING)
    assumed = np.where(crosses, RoadType.JUNCTION, RoadType.URBAN)
    return [int(assumed[i] if spec.road_type is None else spec.road_type) for i, spec in enumerate(specs)]


def _signals(specs: Sequence[LaneSpec], length: np.ndarray) -> list[list[tuple[int, float]]]:
    """Signal id and stop-line station of each link."""
    out = []
    for spec, total in zip(specs, length, strict=True):
        row = [(g, float(total) if s is None else float(s)) for g, s in spec.signals]
        if any(g < 0 or not 0 <= s <= total + ROUNDING for g, s in row):
            raise RoadError(
                f"lane {spec.key!r}: a signal id is negative or its stop line is not within 0..{total:.1f} m"
            )
        out.append(row)
    return out


def _neighbours(specs: Sequence[LaneSpec], index: dict[Hashable, int]) -> dict[str, np.ndarray]:
    """Neighbour links [L] on each side, -1 for none; what one lane states of another holds both ways."""
    out = {
        side: np.array([-1 if key is None else index[key] for key in (getattr(spec, side) for spec in specs)])
        for side in ("left", "right")
    }
    for side, other in (("left", "right"), ("right", "left")):
        for i, j in enumerate(out[side].copy()):
            if j == i:
                raise RoadError(f"lane {specs[i].key!r} is its own neighbour")
            if j >= 0 and out[other][j] < 0:
                out[other][j] = i
    return out


def _origin(centre: np.ndarray, origin: tuple[float, float] | None) -> np.ndarray:
    if origin is not None:
        at = np.asarray(origin, float)
    elif np.abs(centre).max() <= FAR:
        at = np.zeros(2)
    else:
        at = np.round(0.5 * (centre.min((0, 1)) + centre.max((0, 1))))
    if not np.all(np.isfinite(at)) or np.abs(centre - at).max() > 10 * FAR:
        raise RoadError(
            f"lanes lie more than {10 * FAR / 1000:.0f} km from the origin {tuple(at)}: choose a nearer one"
        )
    return at


def _count(signals: list[list[tuple[int, float]]], given: int | None) -> int:
    """Number of signals of the map."""
    needed = 1 + max((g for row in signals for g, _ in row), default=-1)
    if given is not None and given < needed:
        raise RoadError(f"n_signals is {given}, but signal {needed - 1} is named: raise it or leave it out")
    return needed if given is None else given
