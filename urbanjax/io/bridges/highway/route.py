"""Where a drive in highway-env goes: to its goal or ahead on its road, and in another lane once settled there."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.course import Course
from urbanjax.roadmap.corridor import CorridorParams, corridor_along
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.roadmap.route import RouteParams, Trip, cost_to_go, plan_route
from urbanjax.types import RouteError, Status

BODY = 6.0  # m, a vehicle's length and a bit
SHARED = 1.0  # m between the centres of two lanes: below it, both use the same ground


@dataclasses.dataclass
class Destination:
    """The links at which a drive may end, and what it costs to get there from every link."""

    goals: list[int]
    costs: np.ndarray  # [G, L] m, with the penalties of lane changes
    laps: int

    def best(self, link: int) -> tuple[int, float]:
        """The cheapest goal from a link and its cost."""
        choice = int(np.argmin(self.costs[:, link]))
        return self.goals[choice], float(self.costs[choice, link])


def ahead(graph: RoadGraph, start: int, *, reach: float) -> Destination:
    """The end of the road after `reach` metres along the successors of `start`, in any of its lanes.

    A road that leads back to its start is driven in as many laps as `reach` takes.
    Args: graph, the road graph; start, a link; reach [m].
    """
    host = jax.tree.map(np.asarray, graph)
    link, way, seen = start, float(host.length[start]), [start]
    while way < reach and host.has_successor[link].any():
        link = int(host.successor[link][np.argmax(host.has_successor[link])])
        if link == start:
            break
        if link in seen:
            raise RouteError(f"the road ahead of link {start} leads into a circle without it: set 'destination'")
        seen.append(link)
        way += float(host.length[link])
    closed = bool(host.has_successor[link].any()) and way < reach
    return _destination(graph, _abreast(host, seen[-1]), laps=max(int(np.ceil(reach / way)), 1) if closed else 1)


def toward(graph: RoadGraph, goals: list[int], *, reach: float) -> Destination:
    """The end of the links `goals`, or of the road beyond them as far as all who pass there and nobody else goes on.

    Args: graph, the road graph; goals, links; reach [m], of the road beyond.
    """
    host = jax.tree.map(np.asarray, graph)
    link, way = goals[0], 0.0
    while way < reach and host.has_successor[link].sum() == 1:
        after = int(host.successor[link][np.argmax(host.has_successor[link])])
        if host.has_predecessor[after].sum() != 1 or after in goals:
            break
        link = after
        way += float(host.length[link])
    return _destination(graph, goals if link == goals[0] else _abreast(host, link), laps=1)


def course_to(graph: RoadGraph, start: int, *, destination: Destination, params: CorridorParams) -> Course:
    """The course from link `start` to the nearest goal.

    Args: graph, the road graph; start, a link; destination, where the drive may end. Raises RouteError where none can
    be reached.
    """
    goal, cost = destination.best(start)
    if not np.isfinite(cost):
        raise RouteError(f"none of the goals {destination.goals} can be reached from link {start}")
    course, status = _course(graph, start, goal, destination.laps, RouteParams(), params)
    if int(status) != Status.OK:
        raise RouteError(f"no route from link {start} to link {goal}: {Status(int(status)).message}")
    return course


def shared_ground(graph: RoadGraph) -> np.ndarray:
    """[L] bool: links whose ground an oncoming lane uses too.

    Args: graph, the road graph.
    """
    offset = np.abs(np.asarray(graph.opposite_offset))
    return np.any(np.asarray(graph.has_opposite) & (offset < SHARED), axis=1)


def _destination(graph: RoadGraph, goals: list[int], *, laps: int) -> Destination:
    params = RouteParams()
    costs = np.stack([np.asarray(_cost_to_go(graph, goal, params=params)) for goal in goals])
    return Destination(goals, costs, laps)


def _abreast(graph: RoadGraph, link: int) -> list[int]:
    """The link and the lanes beside it that may be used, from left to right."""
    shared, row = shared_ground(graph), [link]
    for has, to, at in ((graph.has_left, graph.left_link, 0), (graph.has_right, graph.right_link, len(row))):
        here = link
        while has[here] and not shared[int(to[here])]:
            here = int(to[here])
            row.insert(0 if at == 0 else len(row), here)
    return row


_cost_to_go = jax.jit(cost_to_go, static_argnames="changes")


@functools.partial(jax.jit, static_argnames="laps")
def _course(
    graph: RoadGraph,
    start: int | jax.Array,
    goal: int | jax.Array,
    laps: int,
    search: RouteParams,
    params: CorridorParams,
) -> tuple[Course, jax.Array]:
    route = plan_route(graph, start, trip=Trip(goal, laps=laps), params=search)
    corridor = corridor_along(graph, route, params=params)
    corridor = corridor.replace(change=_clear_of_bars(corridor.change, round(BODY / params.spacing)))
    return Course(graph, corridor), jnp.asarray(route.status)


def _clear_of_bars(change: jax.Array, margin: int) -> jax.Array:
    """Where lane changes are permitted [N, Q - 1], at least `margin` stations off every place where they are not.

    The whole body has to cross on ground that joins the lanes, and highway-env counts a lane as going on for a
    vehicle's length beyond its ends.
    """
    window = (2 * margin + 1, 1)
    return jax.lax.reduce_window(change, True, jax.lax.bitwise_and, window, (1, 1), "SAME")
