"""Routes over the road graph: the cheapest through its targets, and the cheapest of what is left of one (Eq. 12)."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int

from urbanjax.roadmap.costs_to_go import cost_to_go, costs_to_go
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.roadmap.moves import COSTS, SEARCHES, RouteParams, link_costs
from urbanjax.roadmap.tracing import Route, Trip, entry_of, itinerary_to, trace
from urbanjax.types import RouteError, Status
from urbanjax.types.arguments import kind, short, whole

__all__ = [
    "COSTS",
    "SEARCHES",
    "Route",
    "RouteParams",
    "Trip",
    "cost_to_go",
    "costs_to_go",
    "entry_of",
    "link_costs",
    "plan_route",
    "reroute",
    "route_between",
]


def plan_route(
    graph: RoadGraph, start: int | Int[Array, ""], *, trip: Trip, params: RouteParams | None = None
) -> Route:
    """The cheapest route from the start of link `start` to the end of the trip's goal (Eq. 12).

    It visits the links `via` of the trip in order, then the goal; with more than one lap this circuit is driven `laps`
    times. Each leg moves on by at least one link, but for a plain route whose start is its goal, which has that one
    link. Legs are optimal one by one; of lane changes at equal cost the latest is taken, but for rounding. No route
    drives a blocked link; one that starts there leaves it by a lane change. Failure is in `status`: UNREACHABLE, or
    TOO_LONG for the R links of `params`; what was found until then is kept.
    Args: graph, the road graph; start, a link; trip, what the route is for.
    """
    params = RouteParams() if params is None else params
    itinerary = itinerary_to(graph, trip, params=params)
    moved = not (trip.via or trip.laps > 1)
    start, leg = jnp.asarray(start, jnp.int32), jnp.asarray(0, jnp.int32)
    return trace(itinerary, start, leg=leg, moved=jnp.asarray(moved), n_links=params.n_links)


def reroute(
    graph: RoadGraph,
    route: Route,
    *,
    link: int | Int[Array, ""],
    station: float | Float[Array, ""],
    trip: Trip,
    params: RouteParams | None = None,
    since: int | Int[Array, ""] = 0,
) -> Route:
    """The cheapest route from `station` [m] on `link` through those targets of `route` that are still ahead.

    Targets passed on `route` are not visited again; off the route, those are that lie behind its entry `since`. The
    first link is where the vehicle is, and its cost counts from there; whether to change lanes is decided as at its
    start. The rest is as in `plan_route`.
    Args: graph, the road graph; route, driven until now; link and station m, where the vehicle is; trip, the one that
    `route` was planned for, with the links that are blocked now; since, the entry of `route` where the vehicle was
    last, which tells apart the laps.
    """
    params = RouteParams() if params is None else params
    itinerary = itinerary_to(graph, trip, params=params)
    link = jnp.asarray(link, jnp.int32)
    entry, on_route = entry_of(route, link, since=since)
    found = trace(itinerary, link, leg=route.leg[entry], moved=~on_route, n_links=params.n_links)
    driven = jnp.argmax(found.valid & ~found.change)
    share = jnp.clip(station / graph.length[link], 0, 1)
    behind = jnp.where(found.status == Status.OK, share * link_costs(graph, params)[found.link[driven]], 0)
    return found.replace(cost=found.cost - behind)


def route_between(
    graph: RoadGraph,
    start: int,
    *,
    goal: int,
    via: tuple[int, ...] = (),
    laps: int = 1,
    params: RouteParams | None = None,
    blocked: Bool[Array, "l"] | np.ndarray | None = None,
) -> Route:
    """`plan_route` for a caller outside jit: raises RouteError, naming the links, where there is no route.

    Args: graph, the road graph; start and goal, links; via, links to visit in between, in order; laps, how often that
    circuit is driven; blocked [L], links that cannot be driven.
    """
    kind(graph, "graph", wanted=RoadGraph, error=RouteError)
    params = RouteParams() if params is None else params
    kind(params, "route params", wanted=RouteParams, error=RouteError)
    valid = np.asarray(graph.valid)
    if not isinstance(via, tuple | list):
        raise RouteError(f"via is {short(via)}: give a tuple of links, () for none")
    links = []
    for name, given in (("start", start), *(("via", link) for link in via), ("goal", goal)):
        try:
            link = whole(given, name, error=RouteError, least=0, most=len(valid) - 1)
        except RouteError:
            link = -1
        if link < 0 or not valid[link]:
            raise RouteError(f"{name} link {short(given)} is not in the road graph: choose one of 0..{valid.sum() - 1}")
        links.append(link)
    start, *between, goal = links
    via = tuple(between)
    laps = whole(laps, "laps", error=RouteError, least=1, most=params.n_links)
    if not (params.change_length >= 0 and params.change_time >= 0):
        raise RouteError(f"lane-change penalties are {params.change_length} m, {params.change_time} s: use 0 or more")
    if blocked is not None and (blocked.shape != valid.shape or blocked.dtype != bool):
        raise RouteError(f"blocked is {blocked.dtype}{list(blocked.shape)}: give a bool for each of {len(valid)} links")
    blocked = None if blocked is None else jnp.asarray(blocked)
    route = _plan_jit(graph, start, trip=Trip(goal, via, blocked, laps), params=params)
    status = Status(int(route.status))
    if status == Status.UNREACHABLE:
        way = "".join(f" via {link}" for link in via) + ("" if blocked is None else " past the blocked links")
        raise RouteError(f"link {goal} cannot be reached from link {start}{way}: check successors and lane changes")
    if status == Status.TOO_LONG:
        raise RouteError(
            f"the route from link {start} to link {goal} has more than {params.n_links} links: raise n_links"
        )
    return route


_plan_jit = jax.jit(plan_route)
