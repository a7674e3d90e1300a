"""Any highway-env road network as a road graph. The screen's y points down: it is flipped here and nowhere later."""

from typing import Any

import numpy as np

from urbanjax.numerics import polynomial
from urbanjax.roadmap.builders.lanes import assemble
from urbanjax.roadmap.builders.specs import LaneSpec
from urbanjax.roadmap.graph import RoadGraph, Turn
from urbanjax.roadmap.padding import GraphSize, pad
from urbanjax.types import RoadError, host_record

LaneKey = tuple[str, str, int, int]  # from node, to node, lane id, piece
DEFAULT_LIMIT = 30.0  # m/s, where a lane has none (highway-env's highways)
FLIP = np.array([1.0, -1.0])
JOIN = 1.5  # m, between lanes that go on into each other
TOUCH = 0.05  # m, between lanes that do so even round a corner (roundabout-generic-v0)
BENT = 0.75  # rad, largest change of heading into a lane that goes on
BENT_BRIDGE = 1.2  # rad, likewise at a corner or beyond a hole
BRIDGE = 12.0  # m, longest hole in a road that is bridged by a link of its own
STRIP = 0.05  # m of no road between two lanes that a change may cross
BLEND = 10.0  # m, over which the end of a lane is led onto its successor
SPACING = 1.5  # m, between the points of a curved lane
FEWEST, MOST = 16, 128  # points of a link
BEFORE, AFTER, PLACES = 4.0, 2.0, 601  # m around a lane's end where the next one's start is sought, and at how many
READ_STRAIGHT, READ_CURVED = 10.0, 0.5  # m, between places at which a lane is read
NEXT = (0.5, 1.5)  # m, and lane widths: sideways distances between which a lane is the next one
FORK = np.radians(30)  # change of heading from which a lane of a fork turns
CUBIC = 41  # points of a bridge
LINKS, POINTS, RELATIONS = (24, 48, 96, 192), (64, 128), (4, 8, 16)  # sizes that networks are padded to


@host_record
class _Part:
    """One lane while it is read: where it ends and what follows."""

    lane: Any
    end: float  # m, station on the lane
    aside: float  # m, lateral offset at its end, right positive as in highway-env
    successors: tuple[tuple[str, str, int], ...]
    bridges: tuple[tuple[str, str, int], ...]  # successors beyond a hole


def read_network(
    network: Any,
    respect_lines: bool = True,
    *,
    max_link: float = np.inf,
    n_points: int | None = None,
    buckets: bool = False,
) -> tuple[RoadGraph, tuple[LaneKey, ...]]:
    """The road graph of a highway-env `RoadNetwork` and, for each link, the lane it stands for.

    Successors follow the nodes where the lanes also meet in space: overlaps are cut and steps of up to 1.5 m blended;
    a hole of up to 12 m (the entries of roundabout-v0) becomes a link of its own, named after the entering lane with
    the following lane's node as its `to`. Neighbours are lanes beside each other in one road.
    Args: network, highway-env's; respect_lines, no lane change across a continuous line; max_link [m], length above
    which the lanes of a road are cut into pieces; n_points, points per link (None: one every 1.5 m of the longest
    curve); buckets, pad sizes so that networks of a kind share one compiled program. Raises RoadError for an empty
    network and for points that are not finite.
    """
    lanes = dict(network.lanes_dict())
    if not lanes:
        raise RoadError("the highway-env road network is empty: add at least one lane")
    for index, lane in lanes.items():
        if not (np.isfinite(lane.length) and lane.length > 0):
            raise RoadError(f"highway-env lane {index}: length {lane.length} is not a positive number")
    parts = {index: _part(network, index) for index in lanes}
    pieces = {index: _pieces(network, index, max_link) for index in lanes}
    specs = [
        spec for index, part in parts.items() for spec in _specs(network, index, part, pieces, parts, respect_lines)
    ]
    if n_points is None:
        longest = max((part.end for part in parts.values() if not _straight(part)), default=0.0)
        n_points = int(np.clip(np.ceil(longest / SPACING) + 1, FEWEST, MOST))
        n_points = _bucket(n_points, POINTS) if buckets else n_points
    graph = assemble(specs, n_points=n_points, gap_tolerance=JOIN)
    if buckets:
        relations = _bucket(graph.opposite.shape[1], RELATIONS)
        size = GraphSize(
            n_links=_bucket(len(specs), LINKS),
            n_successors=_bucket(graph.successor.shape[1], RELATIONS),
            n_relations=relations,
        )
        graph = pad(graph, size)
    return graph, tuple(spec.key for spec in specs)


def _bucket(size: int, buckets: tuple[int, ...]) -> int:
    return next((bucket for bucket in buckets if bucket >= size), size)


def continuations(network: Any, index: tuple[str, str, int]) -> tuple[list[tuple], list[tuple]]:
    """Lanes that go on where lane `index` ends: those that begin there, and those that begin beyond a hole.

    Args: network, highway-env's; index, from node, to node and lane id.
    """
    lane, direct, bridges = network.get_lane(index), [], []
    for node, following in network.graph.get(index[1], {}).items():
        targets = {(index[1], node, i): other for i, other in enumerate(following)}
        places = {target: _beyond(lane, other) for target, other in targets.items()}
        meeting = [
            target
            for target, (_, _, gap, turn) in places.items()
            if gap <= JOIN and turn < (BENT_BRIDGE if gap <= TOUCH else BENT)
        ]
        reachable = [
            t for t, (away, _, gap, turn) in places.items() if away > 0 and gap <= BRIDGE and turn < BENT_BRIDGE
        ]
        direct += meeting
        if not meeting and reachable:
            bridges.append(min(reachable, key=lambda target: _bend(_cubic(lane, network.get_lane(target)))))
    return direct, bridges


def _part(network: Any, index: tuple[str, str, int]) -> _Part:
    lane = network.get_lane(index)
    direct, bridges = continuations(network, index)
    if not direct:
        return _Part(lane, lane.length, 0.0, (), tuple(bridges))
    ahead, aside, *_ = _beyond(lane, network.get_lane(direct[0]))
    return _Part(lane, lane.length + ahead, aside, tuple(direct), tuple(bridges))


def _beyond(lane: Any, following: Any) -> tuple[float, float, float, float]:
    """Start of `following` seen from the end of `lane`: metres ahead, metres aside (right positive), distance, turn.

    The start is sought around the end only, since projections of highway-env wrap on long arcs.
    """
    start = following.position(0.0, 0.0)
    distance = float(np.linalg.norm(start - lane.position(lane.length, 0.0)))
    if distance > BRIDGE:
        return np.inf, np.inf, distance, np.pi
    near = lane.length + np.linspace(-min(BEFORE, 0.5 * lane.length), AFTER, PLACES)
    gaps = np.linalg.norm([lane.position(s, 0.0) - start for s in near], axis=-1)
    station = near[np.argmin(gaps)]
    heading = lane.heading_at(station)
    away = start - lane.position(station, 0.0)
    aside = float(away @ np.array([-np.sin(heading), np.cos(heading)]))
    turn = abs((following.heading_at(0.0) - heading + np.pi) % (2 * np.pi) - np.pi)
    return float(station - lane.length), aside, float(gaps.min()), float(turn)


def _pieces(network: Any, index: tuple[str, str, int], max_link: float) -> int:
    """Number of links of a lane: the same for all lanes of one road, so that neighbours stay beside each other."""
    longest = max(lane.length for lane in network.graph[index[0]][index[1]])
    return max(int(np.ceil(longest / max_link)), 1)


def _straight(part: _Part) -> bool:
    return type(part.lane).__name__ == "StraightLane" and abs(part.aside) < 1e-6  # m, rounding


def _specs(
    network: Any, index: tuple[str, str, int], part: _Part, pieces: dict, parts: dict, respect_lines: bool
) -> list[LaneSpec]:
    """The links of one lane, with the bridges from its end."""
    count = pieces[index]
    bridges = [(index[1], target[1], index[2], -1 - number) for number, target in enumerate(part.bridges)]
    after = [(*target, 0) for target in part.successors] + bridges
    (left, joins_left), (right, joins_right) = _beside(network, index)
    limit = part.lane.speed_limit or DEFAULT_LIMIT
    specs = []
    for k in range(count):
        centre, heading, width = _line(part, part.end * k / count, part.end * (k + 1) / count)
        if not (np.isfinite(centre).all() and np.isfinite(width).all()):
            raise RoadError(f"highway-env lane {index}: its points are not finite")
        specs.append(
            LaneSpec(
                key=(*index, k),
                centre=centre,
                heading=heading,
                width=width,
                speed_limit=limit,
                turn=_turn(network, index, heading, centre),
                successors=tuple(after) if k + 1 == count else ((*index, k + 1),),
                left=(*left, k) if left else None,
                left_change=joins_left and _may_cross(network, index, left, 0, respect_lines),
                right=(*right, k) if right else None,
                right_change=joins_right and _may_cross(network, index, right, 1, respect_lines),
            )
        )
    return specs + [_bridge(part, parts[t], (*t, 0), key) for t, key in zip(part.bridges, bridges, strict=True)]


def _line(part: _Part, begin: float, end: float) -> tuple[np.ndarray, np.ndarray | None, np.ndarray]:
    """Centre [n, 2], heading [n] (None where highway-env's is a staircase) and width [n] of a lane, y up."""
    spacing = READ_STRAIGHT if _straight(part) else READ_CURVED
    s = np.linspace(begin, end, max(int(np.ceil((end - begin) / spacing)) + 1, 4))
    length = min(BLEND, 0.5 * part.end)
    u = np.clip((s - (part.end - length)) / length, 0.0, 1.0)
    offset, slope = part.aside * polynomial.smoothstep(u), part.aside * polynomial.smoothstep_slope(u) / length
    centre = np.array([part.lane.position(float(x), float(d)) for x, d in zip(s, offset, strict=True)]) * FLIP
    width = np.array([part.lane.width_at(float(x)) for x in s], float)
    if hasattr(part.lane, "curve"):
        return centre, None, width
    heading = np.array([part.lane.heading_at(float(x)) for x in s]) + np.arctan(slope)
    return centre, -np.unwrap(heading), width


def _beside(network: Any, index: tuple[str, str, int]) -> tuple[tuple[tuple | None, bool], tuple[tuple | None, bool]]:
    """The lanes of the same road to the left and to the right, within a lane's width, and whether their borders meet.

    They do not where highway-env draws a strip of no road between two lanes, as on the slant of the racetrack.
    """
    lane = network.get_lane(index)
    found: dict[bool, tuple[tuple, bool]] = {}
    for other in network.side_lanes(index):
        beside = network.get_lane(other)
        point = beside.position(beside.length / 2, 0.0)
        stations = np.linspace(0.0, lane.length, 65)  # close enough for the side and the distance
        middle = stations[np.argmin(np.linalg.norm([lane.position(s, 0.0) - point for s in stations], axis=-1))]
        heading = lane.heading_at(middle)
        aside = (point - lane.position(middle, 0.0)) @ np.array([-np.sin(heading), np.cos(heading)])
        width = 0.5 * (lane.width_at(middle) + beside.width_at(beside.length / 2))
        if NEXT[0] < abs(aside) <= NEXT[1] * width:
            found[bool(aside < 0)] = other, bool(abs(aside) - width < STRIP)
    nothing = (None, False)
    return found.get(True, nothing), found.get(False, nothing)


def _may_cross(network: Any, index: tuple, other: tuple, side: int, respect_lines: bool) -> bool:
    """Whether a change to `other` on `side` (0 left, 1 right) is allowed: not forbidden there, no continuous line.

    A lane's own line on that side counts; where it draws none, the other lane's line does.
    """
    from highway_env.road.lane import LineType

    if network.get_lane(other).forbidden:
        return False
    drawn = [(network.get_lane(index).line_types, side), (network.get_lane(other).line_types, 1 - side)]
    between = [types[k] for types, k in drawn if types is not None and types[k] != LineType.NONE]
    solid = between and between[0] in (LineType.CONTINUOUS, LineType.CONTINUOUS_LINE)
    return not (respect_lines and solid)


def _turn(network: Any, index: tuple[str, str, int], heading: np.ndarray | None, centre: np.ndarray) -> Turn:
    """Which way a lane turns, where the road before it forks."""
    if len(network.graph[index[0]]) < 2:
        return Turn.STRAIGHT
    if heading is None:
        chords = np.diff(centre, axis=0)
        heading = np.unwrap(np.arctan2(chords[:, 1], chords[:, 0]))
    change = heading[-1] - heading[0]
    if abs(change) < FORK:
        return Turn.STRAIGHT
    return Turn.LEFT if change > 0 else Turn.RIGHT


def _bridge(part: _Part, following: _Part, target: LaneKey, key: LaneKey) -> LaneSpec:
    """A link from the end of a lane to the start of one that follows beyond a hole."""
    limit = following.lane.speed_limit or DEFAULT_LIMIT
    width = float(part.lane.width_at(part.lane.length))
    centre = _cubic(part.lane, following.lane)
    return LaneSpec(key=key, centre=centre, width=width, speed_limit=limit, successors=(target,))


def _cubic(lane: Any, following: Any) -> np.ndarray:
    """Points [CUBIC, 2], y up, of a cubic from the end of `lane` to the start of `following`."""
    ends = [lane.position(lane.length, 0.0) * FLIP, following.position(0.0, 0.0) * FLIP]
    span = np.linalg.norm(ends[1] - ends[0])
    angles = [-lane.heading_at(lane.length), -following.heading_at(0.0)]
    tangents = [span * np.array([np.cos(angle), np.sin(angle)]) for angle in angles]
    u = np.linspace(0.0, 1.0, CUBIC)[:, None]
    begin, end, out, back = polynomial.hermite(u)
    return begin * ends[0] + end * ends[1] + out * tangents[0] + back * tangents[1]


def _bend(points: np.ndarray) -> float:
    """Largest curvature of a polyline, 1/m."""
    chords = np.diff(points, axis=0)
    angles = np.unwrap(np.arctan2(chords[:, 1], chords[:, 0]))
    return float(np.max(np.abs(np.diff(angles)) / np.linalg.norm(chords[1:], axis=-1)))
