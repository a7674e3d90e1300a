"""Roads drawn from ranges, each with a route on it (host side). A generator of the same state draws the same road."""

import numpy as np

from urbanjax.roadmap.builders import curve, district, intersection, roundabout, straight, two_way
from urbanjax.roadmap.builders.curves import trace
from urbanjax.roadmap.builders.lanes import assemble
from urbanjax.roadmap.builders.sections import corridor
from urbanjax.roadmap.builders.specs import RoadStyle
from urbanjax.roadmap.graph import RoadGraph, RoadType
from urbanjax.types import host_record

SPEED_LIMIT = (40 / 3.6, 60 / 3.6)  # m/s
LANE_WIDTH = (3.2, 3.75)  # m
LANES = (2, 4)  # of a road in one direction
RADIUS = (150.0, 500.0)  # m, of the left edge of a bend
LENGTH = 400.0  # m
LEAD = 100.0  # m, before and after a bend
SECTION = 100.0  # m, of a link
LEG = 100.0  # m, of an intersection
TIGHT = (2.5, 4.0)  # m, from the edge of the road to the ends of the legs, at a corner for tight turns
RING = (12.0, 18.0)  # m, radius of a roundabout
LEGS = 4
LEAST = 35.0  # m, of a link that is half as long as one on which a route begins
AHEAD = 420.0  # m, of the district, that a route has at least
STEPS = {"left": 3, "straight": 2, "right": 1}  # legs further on, counter-clockwise


@host_record
class DrawnRoad:
    """A road graph and the links between which its route leads."""

    graph: RoadGraph
    start: int
    goal: int
    speed_limit: float  # m/s


def style(rng: np.random.Generator) -> RoadStyle:
    """Speed limit and lane width. Args: rng."""
    limit, width = rng.uniform(*SPEED_LIMIT), rng.uniform(*LANE_WIDTH)
    return RoadStyle(lane_width=float(width), speed_limit=float(limit), section=SECTION)


def multilane(rng: np.random.Generator) -> DrawnRoad:
    """Two to four lanes in one direction, straight or round a bend; the route keeps one of the lanes. Args: rng."""
    how, n = style(rng), int(rng.integers(LANES[0], LANES[1] + 1))
    lane = int(rng.integers(n))
    if rng.random() < 0.5:
        graph = straight(n, LENGTH, style=how)
    else:
        radius = float(rng.uniform(*RADIUS))
        angle = float(rng.choice([-1, 1]) * (LENGTH - 2 * LEAD) / radius)
        graph = curve(radius, angle, n_lanes=n, lead=LEAD, style=how)
    return DrawnRoad(graph, lane, graph.length.shape[0] - n + lane, how.speed_limit)


def dual(rng: np.random.Generator) -> DrawnRoad:
    """Two lanes in one direction, straight; the route keeps the right one. Args: rng."""
    how = style(rng)
    graph = straight(2, LENGTH, style=how)
    return DrawnRoad(graph, 1, graph.length.shape[0] - 1, how.speed_limit)


def undivided(rng: np.random.Generator) -> DrawnRoad:
    """One lane each way, where the oncoming lane may be used to overtake. Args: rng."""
    how = style(rng)
    plain = RoadStyle(lane_width=how.lane_width, speed_limit=how.speed_limit)
    return DrawnRoad(two_way(length=LENGTH, style=plain), 0, 0, how.speed_limit)


def lane_drop(rng: np.random.Generator) -> DrawnRoad:
    """Two or three lanes of which the rightmost ends; the route begins in it and goes on in the next. Args: rng."""
    how, n = style(rng), int(rng.integers(2, 4))
    ends = float(rng.uniform(150.0, 200.0))
    specs = corridor(
        "road",
        trace([(LENGTH, 0.0, 0.0)]),
        breaks=[0.0, ends, LENGTH],
        n_lanes=[n, n - 1],
        lane_width=how.lane_width,
        speed_limit=how.speed_limit,
    )
    return DrawnRoad(assemble(specs, how.n_points), n - 1, 2 * n - 2, how.speed_limit)


def crossing(rng: np.random.Generator, *, turn: str, signals: bool, tight: bool = False) -> DrawnRoad:
    """An intersection of roads with one or two lanes each way; without signals the route comes from a leg that yields.

    Args: rng; turn, left, straight or right; signals, whether there are; tight, whether the corners are.
    """
    how, n = style(rng), 1 if tight else int(rng.integers(1, 3))
    size = n * how.lane_width + float(rng.uniform(*TIGHT)) if tight else 0.0
    graph = intersection(
        signals, n, leg=LEG, size=size, lane_width=how.lane_width, speed_limit=how.speed_limit, n_points=how.n_points
    )
    leg = int(rng.integers(LEGS)) if signals or tight else int(rng.choice([1, 3]))
    lane = {"left": 0, "straight": int(rng.integers(n)), "right": n - 1}[turn]
    goal = (LEGS + (leg + STEPS[turn]) % LEGS) * n + lane
    return DrawnRoad(graph, leg * n + lane, goal, how.speed_limit)


def ring(rng: np.random.Generator) -> DrawnRoad:
    """A roundabout, from one leg to one of the other three. Args: rng."""
    how = style(rng)
    leg, onwards = int(rng.integers(LEGS)), int(rng.integers(1, LEGS))
    graph = roundabout(float(rng.uniform(*RING)), leg=LEG, style=how)
    return DrawnRoad(graph, leg, LEGS + (leg + onwards) % LEGS, how.speed_limit)


def city(rng: np.random.Generator) -> DrawnRoad:
    """The district, from a link drawn among those where the road is open and has lanes beside. Args: rng."""
    how = style(rng)
    graph = district(how.lane_width, how.speed_limit, n_points=how.n_points)
    following, has = np.asarray(graph.successor), np.asarray(graph.has_successor)
    open_road = np.asarray(graph.valid) & (np.asarray(graph.road_type) != RoadType.JUNCTION)
    beside = np.asarray(graph.has_left) | np.asarray(graph.has_right)
    length = np.asarray(graph.length)
    for start in rng.permutation(np.flatnonzero(open_road & beside & (length > 2 * LEAST))):
        link, way = int(start), float(length[start])
        while way < AHEAD and has[link].any():
            link = int(following[link][has[link]][0])
            way += float(length[link])
        if way >= AHEAD:
            return DrawnRoad(graph, int(start), link, how.speed_limit)
    raise AssertionError("the district is a closed course")
