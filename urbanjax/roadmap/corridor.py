"""The corridor M_ext: the lanes across a route, on uniform stations along its reference line."""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jaxtyping import Float

from urbanjax.roadmap.across import LanesAcross, lanes_across
from urbanjax.roadmap.graph import RoadGraph, Rule
from urbanjax.roadmap.priority import rank
from urbanjax.roadmap.reference import ReferenceRow, Walk, rows, unwrapped, walk
from urbanjax.roadmap.route import Route
from urbanjax.types import POSITIVE, RoadError, pytree, static

ANYWHERE = 1e6  # m, the line of who gives way to others without a sign
BLENDED = 0.15  # share of a lane change, at its start and its end, in which the lane that is nearer decides alone
SLACK = 1.01  # by which the reference line may be longer than the links that it covers
CHUNKS = 512, 16  # stations and stop lines: sizes are multiples, so that routes share a program


@pytree
class Corridor:
    """N stations, `spacing` apart, along the route's reference line; Q lanes across, from right (0) to left (Q - 1).

    Lane Q // 2 is the route's own lane: its offset is 0. Where the route changes lanes, the reference line moves over
    from one lane to the next and the lanes beside move with it, so that each lane across is continuous along the route;
    while they lie between the marked lanes, they exist only where there is a marked lane before *and* after. The whole
    route is one such table; `window` cuts the part around the vehicle, with the same fields and fewer stations.
    """

    station: Array  # [N] m from the start of the route, uniform
    position: Array  # [N, 2] m, reference line
    heading: Array  # [N] rad, unwrapped
    curvature: Array  # [N] 1/m
    lane_offset: Array  # [N, Q] m, lane centres, left positive
    lane_width: Array  # [N, Q] m
    lane_link: Array  # [N, Q] int32, link of the road graph
    has_lane: Array  # [N, Q] bool
    oncoming: Array  # [N, Q] bool, a lane whose direction is against the route
    change: Array  # [N, Q - 1] bool, changing between lanes q and q + 1 is permitted here
    speed_limit: Array  # [N] m/s
    turn: Array  # [N] int32, Turn of the route's link
    rank: Array  # [N] ranks below priority of who comes here along the route, see `roadmap.priority`
    line: Array  # [N] m, where one who gives way to somebody who comes here has to wait, at the latest
    valid: Array  # [N] bool, false beyond the end of the route
    length: Array  # [] m, of the route
    stop_station: Array  # [Y] m, stop lines on the route
    stop_signal: Array  # [Y] int32, signal id of each
    has_stop: Array  # [Y] bool
    spacing: float = static(default=1.0)  # m

    @property
    def route_lane(self) -> int:
        """Index across of the route's own lane."""
        return self.lane_offset.shape[-1] // 2


@pytree
class CorridorParams:
    """How the lanes around a route are sampled."""

    blend_length: float = 30.0  # m, over which the reference line moves to the next lane
    n_stations: int = static(default=1024)  # N
    spacing: float = static(default=1.0, metadata=POSITIVE)  # m
    lanes: int = static(default=5)  # Q, odd
    n_stops: int = static(default=16)  # Y


@pytree
class WindowParams:
    """The part of the route that one step looks at."""

    PINNED: ClassVar[dict[str, str]] = {
        "behind": "definition: of the part of the route that is looked at, whose length is given",
    }

    behind: float = 50.0  # m, how much of it lies behind the vehicle
    n_stations: int = static(default=256)  # W


def corridor_along(graph: RoadGraph, route: Route, *, params: CorridorParams) -> Corridor:
    """The corridor along a route (IV-C.3); pure, of static size.

    Beyond the end of the route the reference line goes straight on and `valid` is false. A route of more than N
    stations is cut off there, while `length` is still its own. Raises RoadError on impossible sizes.
    Args: graph, the road graph; route, through it.
    """
    if params.lanes % 2 == 0 or params.n_stations < 2 or not params.spacing > 0:
        sizes = f"{params.lanes}, {params.n_stations} and {params.spacing}"
        raise RoadError(f"lanes must be odd, n_stations 2 or more and spacing positive, not {sizes}")
    path = walk(graph, route)
    grid = params.spacing * jnp.arange(params.n_stations, dtype=graph.length.dtype)

    def at(u: Array, _: None) -> tuple[Array, tuple[ReferenceRow, Array]]:
        """The rows at u, the arc length of the line if u is uniform, and the u that uniform arc length asks for."""
        row = rows(graph, path, u=u, blend_length=params.blend_length)
        arc = jnp.pad(jnp.cumsum(0.5 * (row.speed[1:] + row.speed[:-1])) * params.spacing, (1, 0))
        return jnp.interp(grid, arc, grid) + jnp.maximum(grid - arc[-1], 0), (row, arc)

    # Twice the same: at uniform u to measure the line, then at uniform arc length.
    _, (twice, measured) = lax.scan(at, grid, length=2)
    row, arc = jax.tree.map(lambda x: x[1], twice), measured[0]
    lanes = _lanes(graph, path, row, params.lanes)
    length = _station(path.total, grid, arc)
    link, following = path.link[row.entry], path.following[row.entry]
    limit = graph.speed_limit[link] * (1 - row.weight) + graph.speed_limit[following] * row.weight
    own = jnp.where(row.weight < 0.5, link, following)
    station, signal, has = _stops(graph, path, route, grid, arc, params.n_stops)
    rank_along, line = _rules(graph, path, row, _station(path.begin, grid, arc))
    return Corridor(
        station=grid,
        position=row.position,
        heading=unwrapped(row.heading),
        curvature=row.curvature,
        lane_offset=lanes.offset,
        lane_width=lanes.width,
        lane_link=lanes.link,
        has_lane=lanes.has,
        oncoming=lanes.oncoming,
        change=lanes.change,
        speed_limit=limit,
        turn=graph.turn[own],
        rank=rank_along,
        line=line,
        valid=grid <= length,
        length=length,
        stop_station=station,
        stop_signal=signal,
        has_stop=has,
        spacing=params.spacing,
    )


def sized(graph: RoadGraph, route: Route, *, params: CorridorParams, margin: float = 300.0) -> CorridorParams:
    """`params` with room for the whole route, `margin` metres beyond its end, and all its stop lines (host side).

    Sizes are rounded up, so that routes of similar length share one compiled program.
    Args: graph, the road graph; route, through it; margin m.
    """
    path = walk(graph, route)
    stops = int(np.sum(np.asarray(graph.has_signal[route.link] & route.valid[:, None])))
    n = int(np.ceil((float(path.total) * SLACK + margin) / params.spacing))
    return params.replace(n_stations=_rounded(n, CHUNKS[0]), n_stops=max(_rounded(stops, CHUNKS[1]), CHUNKS[1]))


def _rounded(n: int, chunk: int) -> int:
    """The next multiple of the chunk."""
    return -(-n // chunk) * chunk


def _station(u: Array, grid: Array, arc: Array) -> Array:
    """Station [m] along the reference line at each u [m]."""
    return jnp.interp(u, grid, arc) + jnp.maximum(u - grid[-1], 0)


def _lanes(graph: RoadGraph, path: Walk, row: ReferenceRow, lanes: int) -> LanesAcross:
    """The lanes across each row; where the route changes lanes, those seen from either of the two, mixed by weight."""
    link, following, change = path.link[row.entry], path.following[row.entry], path.change[row.entry]
    other = jnp.where(change, following, link)
    station = jnp.where(change, row.following_station, row.station)
    pairs = ((link, other), (row.station, station), (row.position, row.position), (row.heading, row.heading))
    links, stations, positions, headings = (jnp.concatenate(pair) for pair in pairs)
    across = lanes_across(graph, links, station=stations, position=positions, heading=headings, lanes=lanes)
    a, b = (jax.tree.map(lambda x, i=i: jnp.split(x, 2)[i], across) for i in range(2))
    w = row.weight[:, None]
    early, late = w < BLENDED, w > 1 - BLENDED
    nearer = jax.tree.map(lambda x, y: jnp.where(w < 0.5, x, y), a, b)
    return nearer.replace(
        offset=(1 - w) * a.offset + w * b.offset,
        width=(1 - w) * a.width + w * b.width,
        has=(a.has | late) & (b.has | early),
        oncoming=(a.oncoming & ~late) | (b.oncoming & ~early),
    )


def _stops(graph: RoadGraph, path: Walk, route: Route, grid: Array, arc: Array, n: int) -> tuple[Array, Array, Array]:
    """Stations, signals and mask [n] of the stop lines of the route, in driving order."""
    passed = (route.valid & ~path.change)[:, None] & graph.has_signal[path.link]
    u = (path.begin - path.start)[:, None] + graph.stop_line[path.link]
    u, signal = u.ravel(), graph.signal[path.link].ravel()
    order = jnp.argsort(jnp.where(passed.ravel(), u, jnp.inf))[:n]
    order = jnp.pad(order, (0, n - order.shape[0]))
    has = jnp.arange(n) < jnp.sum(passed)
    return jnp.where(has, _station(u[order], grid, arc), 0), jnp.where(has, signal[order], 0), has


def _rules(graph: RoadGraph, path: Walk, row: ReferenceRow, begin: Array) -> tuple[Array, Array]:
    """Rank below priority and line to wait at (m), [N] each.

    Who changes lanes gives way to who is there already. Args: begin [R] m, station of each entry of the walk.
    """
    before = jnp.maximum(row.entry - 1, 0)
    entered = (row.entry > 0) & ~path.change[before]
    rule = jnp.where(entered, graph.rule[path.link[before]], int(Rule.NONE))
    below = rank(rule, graph.turn[path.link[row.entry]], like=begin)
    changes = (path.change[row.entry] & (row.weight > 0)).astype(below.dtype)
    line = jnp.where(rule != Rule.NONE, begin[row.entry], ANYWHERE)
    return below + changes, line


def window(corridor: Corridor, station: Float[Array, ""], *, params: WindowParams) -> Corridor:
    """The W stations from `behind` metres behind `station`; at the ends of the table, the first or last W.

    Piecewise constant in the station; whatever is read from the window by station does not depend on where it begins.
    Args: corridor, along the whole route; station m from its start.
    """
    size = corridor.station.shape[0]
    steps = (station - params.behind - corridor.station[0]) / corridor.spacing
    start = jnp.clip(jnp.floor(steps), 0, max(size - params.n_stations, 0)).astype(jnp.int32)

    def cut(x: Array) -> Array:
        return lax.dynamic_slice_in_dim(x, start, min(params.n_stations, size))

    along = ("station", "position", "heading", "curvature", "lane_offset", "lane_width", "lane_link", "has_lane")
    rules = ("oncoming", "change", "speed_limit", "turn", "rank", "line", "valid")
    return corridor.replace(**{name: cut(getattr(corridor, name)) for name in (*along, *rules)})
