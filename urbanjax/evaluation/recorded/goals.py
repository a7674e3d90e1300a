"""Goals of planning problems: as what a drive is to reach, and where on its route they lie (host side)."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.evaluation.aim import Aim, arrived, inside
from urbanjax.evaluation.recorded.planning_problem import Goal, Region
from urbanjax.evaluation.recorded.scenes import EgoStart
from urbanjax.geometry.boxes import box, corners
from urbanjax.roadmap.corridor import Corridor
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.roadmap.progress import progress
from urbanjax.types import ScenarioError, as_arrays

DISC = 32  # corners of the polygon that stands for a disc
NEVER, ALWAYS = (np.inf, -np.inf), (-np.inf, np.inf)
ROUND = 7.0  # rad, more than any heading can be turned


def reached(start: EgoStart, graph: RoadGraph, *, path: np.ndarray, speed: np.ndarray, period: float) -> bool:
    """Whether some goal holds in some step: its time, place, speed and heading, as far as it names them.

    Args: start, with the goals; graph, the road graph; path [T, 3] x, y (m), heading (rad) of the box centre; speed [T]
    m/s; period [s]; host arrays.
    """
    aim = jax.tree.map(lambda x: x[0], aims([start], graph))
    time = (start.first + np.arange(len(path))) * period
    place, heading = np.asarray(path[:, :2], float), np.asarray(path[:, 2], float)
    drive: dict[str, Any] = {"time": time, "position": place, "heading": heading, "speed": np.asarray(speed, float)}
    return bool(jnp.any(arrived(aim, **as_arrays({name: jnp.asarray(x) for name, x in drive.items()}))))


def aims(starts: Sequence[EgoStart], graph: RoadGraph) -> Aim:
    """What the problems ask for, [E, ...], all of one shape.

    Args: starts, E of them, with their goals; graph, the road graph.
    """
    places = [[_outlines(goal, graph) for goal in start.goals] for start in starts]
    count = max([1, *(len(start.goals) for start in starts)])
    most = max([1, *(len(outlines) for goals in places for outlines in goals)])
    points = max([1, *(len(outline) for goals in places for outlines in goals for outline in outlines)])
    outline = np.zeros((len(starts), count, most, points, 2))
    bounds = {name: np.zeros((len(starts), count, 2)) for name in ("time", "speed", "heading")}
    bounds["time"][:] = NEVER  # of goals that there are not
    anywhere = np.zeros((len(starts), count), bool)
    for e, start in enumerate(starts):
        for g, goal in enumerate(start.goals):
            for k, corner in enumerate(places[e][g]):
                outline[e, g, k] = corner[np.minimum(np.arange(points), len(corner) - 1)]
            anywhere[e, g] = not places[e][g]
            bounds["time"][e, g] = ALWAYS if goal.time is None else goal.time
            bounds["speed"][e, g] = ALWAYS if goal.speed is None else goal.speed
            low, high = (0.0, ROUND) if goal.heading is None else goal.heading
            bounds["heading"][e, g] = low, high - low
    rows: dict[str, Any] = {"outline": outline, **bounds}
    return Aim(**as_arrays({name: jnp.asarray(x) for name, x in rows.items()}), anywhere=jnp.asarray(anywhere))


def entry(start: EgoStart, aim: Aim, *, corridor: Corridor) -> float:
    """Where the route, or else a lane beside it, first comes to lie in the place of a goal, a station [m].

    Args: start, of a problem; aim, its goals; corridor, along its route. Raises ScenarioError where that is nowhere, or
    where a goal names no place.
    """
    if not start.goals or any(not goal.links and not goal.regions for goal in start.goals):
        names = "lanes that cannot be driven" if any(goal.lanes for goal in start.goals) else "no place"
        raise ScenarioError(f"{start.name}: a goal names {names}, so that it is no station of the route")
    across = np.stack([-np.sin(corridor.heading), np.cos(corridor.heading)], axis=-1)[:, None]
    lanes = np.asarray(corridor.position)[:, None] + np.asarray(corridor.lane_offset)[..., None] * across
    within = np.asarray(_inside(aim, as_arrays(lanes.reshape(-1, 2)))).any(1).reshape(lanes.shape[:2])
    within &= np.asarray(corridor.has_lane) & np.asarray(corridor.valid)[:, None]
    there = within[:, corridor.route_lane]
    there = there if there.any() else within.any(1)
    if not there.any():
        raise ScenarioError(f"{start.name}: no goal is a station of the route, which leads past all of their places")
    return float(corridor.station[there.argmax()])


def station(corridor: Corridor, position: np.ndarray, *, heading: float) -> float:
    """Where a pose is along a route, at most at its end, a station [m].

    Args: corridor, along the route; position [2] m; heading [rad].
    """
    return float(np.minimum(_progress(*as_arrays((corridor, position, heading))), corridor.length))


_inside = jax.jit(inside)
_progress = jax.jit(lambda corridor, position, heading: progress(corridor, position, heading=heading).station)


def _outlines(goal: Goal, graph: RoadGraph) -> list[np.ndarray]:
    """The places of a goal as polygons."""
    lanes = [np.concatenate([graph.left[link], np.asarray(graph.right[link])[::-1]]) for link in goal.links]
    return lanes + [_outline(region) for region in goal.regions]


def _outline(region: Region) -> np.ndarray:
    """The corners [n, 2] (m) of a region; 32 of a disc."""
    centre = np.asarray(region.centre, float)
    if region.corners is not None:
        return np.asarray(region.corners, float)
    if region.radius:
        angle = np.arange(DISC) * (2 * np.pi / DISC)
        return centre + region.radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    place = (jnp.asarray(x, float) for x in (centre, region.heading, region.length, region.width))
    at, heading, length, width = place
    return np.asarray(corners(box(at, heading, length=length, width=width)))
