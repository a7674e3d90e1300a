"""The routes that drivers in recorded traffic are given (host side)."""

import contextlib
from collections.abc import Sequence

from urbanjax.roadmap.graph import RoadGraph, Turn
from urbanjax.roadmap.route import Route, RouteParams, route_between
from urbanjax.types import RouteError

AHEAD = 200.0  # m, for which a route goes on beyond where the recorded drive ends
LONG_ROUTE = 64  # links


def find_route(graph: RoadGraph, start: int, *, goals: Sequence[int]) -> Route:
    """The cheapest route from a link to one of `goals`, and on for 200 m. Raises RouteError where none is reached.

    Args: graph, the road graph; start, a link; goals, links.
    """
    params = RouteParams(n_links=LONG_ROUTE)
    found: list[Route] = []
    for goal in goals:
        with contextlib.suppress(RouteError):
            found.append(route_between(graph, start, goal=goal, params=params))
    if not found:
        raise RouteError(f"none of the links {list(goals)} can be reached from link {start}")
    best = min(found, key=lambda route: float(route.cost))
    last = int(best.link[int(best.valid.sum()) - 1])
    beyond = _onwards(graph, last)
    if beyond == last:
        return best
    via = () if last == start else (last,)
    return route_between(graph, start, goal=beyond, via=via, params=params)


def beside(graph: RoadGraph, link: int) -> list[int]:
    """The lanes beside a link in its direction. Args: graph, the road graph; link, whose neighbours are asked for."""
    lanes = []
    for side, there in ((graph.left_link, graph.has_left), (graph.right_link, graph.has_right)):
        at = link
        while bool(there[at]) and int(side[at]) not in (link, *lanes):
            at = int(side[at])
            lanes.append(at)
    return lanes


def _onwards(graph: RoadGraph, link: int) -> int:
    """The link 200 m further on, or the last one before the map ends; at forks the one that turns least, never back."""
    way, seen = 0.0, {link}
    while way < AHEAD:
        options = [int(s) for s, has in zip(graph.successor[link], graph.has_successor[link], strict=True) if has]
        options = [s for s in options if s not in seen and int(graph.turn[s]) != Turn.U_TURN]
        if not options:
            break
        link = min(options, key=lambda s: abs(float(graph.heading[s, -1] - graph.heading[s, 0])))
        seen.add(link)
        way += float(graph.length[link])
    return link
