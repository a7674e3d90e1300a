"""What a mission is driven on: the map and the route through it."""

import jax

from urbanjax.registration.voxelmap import VoxelMap
from urbanjax.roadmap.corridor import Corridor, CorridorParams, corridor_along, sized
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.roadmap.route import RouteParams, route_between
from urbanjax.types import RouteError, as_arrays, pytree
from urbanjax.types.arguments import kind


@pytree
class Course:
    """The road graph with the corridor along one route; constant while the route holds."""

    graph: RoadGraph
    corridor: Corridor
    map: VoxelMap | None = None  # the point-cloud map, for a localizer that needs one


def course_between(
    graph: RoadGraph,
    start: int,
    *,
    goal: int,
    via: tuple[int, ...] = (),
    laps: int = 1,
    route: RouteParams | None = None,
    corridor: CorridorParams | None = None,
) -> Course:
    """The course along the cheapest route from link `start` to link `goal`, for a caller outside jit.

    Raises RouteError, naming the links, where there is no route, and for arguments of another kind. Args: graph, the
    road graph; start and goal, links; via, links to visit in between, in order; laps, how often that circuit is driven;
    route, sizes and costs of the search; corridor, how the lanes around the route are sampled; its sizes are enlarged
    to hold the whole route.
    """
    if corridor is not None:
        kind(corridor, "corridor", wanted=CorridorParams, error=RouteError)
    found = route_between(graph, start, goal=goal, via=via, laps=laps, params=route)
    params = as_arrays(sized(graph, found, params=corridor or CorridorParams()))
    return Course(graph, _extend(graph, found, params=params))


_extend = jax.jit(corridor_along)
