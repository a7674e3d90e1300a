"""The road graph as the simulator reads it: uniform tables along each link, so that a look-up is arithmetic."""

import functools

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int

from urbanjax.geometry import polyline
from urbanjax.geometry.polyline import Projection
from urbanjax.numerics import polynomial
from urbanjax.roadmap.edges import road_edges
from urbanjax.roadmap.graph import RoadGraph, RoadType
from urbanjax.roadmap.locate import Onwards, onwards
from urbanjax.types import RoadError, pytree, static
from urbanjax.types.arguments import kind, whole

# Columns of the table.
X, Y, HEADING, LEFT_STATION, LEFT_DISTANCE, RIGHT_STATION, RIGHT_DISTANCE = range(7)


@pytree
class LaneTables:
    """Derived once from a `RoadGraph` by `from_graph`; L links, P points each."""

    graph: RoadGraph
    table: Array  # [L * P, 7], at uniform stations: see the columns above; distances are to the neighbour's centre
    successor: Array  # [L, S] int32, the valid ones first
    n_successors: Array  # [L] int32
    curvature: Array  # [L] 1/m, greatest magnitude along the link
    width: Array  # [L] m, mean
    ends: Array  # [L] bool, the lane ends but its neighbour goes on: one stops at the end, and does not leave
    rival: Array  # [L, R] int32, links that cross or merge with this one inside a junction
    has_rival: Array  # [L, R] bool
    edge: Array  # [L * C, K, 8], the edges of the road near each part of a link, see `road_edges`
    ways: Onwards  # [L, E], where one can be a moment later
    n_points: int = static(default=2)
    has_conflicts: bool = static(default=False)


def from_graph(graph: RoadGraph, n_points: int = 63, *, n_ways: int | None = None) -> LaneTables:
    """The simulator's tables of a road graph; done once, outside jit.

    Args: graph; n_points, per link; n_ways, places for links that can be reached at once (None: as few as it can be).
    """
    kind(graph, "graph", wanted=RoadGraph, error=RoadError)
    n_points = whole(n_points, "n_points", error=RoadError, least=2)
    lanes = _tables(graph, road_edges(graph), onwards(graph, n_ways), n_points=n_points)
    entered_twice = jnp.sum(graph.has_predecessor, axis=1) > 1
    return lanes.replace(has_conflicts=bool(jnp.any(lanes.has_rival) | jnp.any(entered_twice)))


@functools.partial(jax.jit, static_argnames="n_points")
def _tables(graph: RoadGraph, edge: Array, ways: Onwards, n_points: int) -> LaneTables:
    n_links = graph.station.shape[0]
    order = jnp.argsort(~graph.has_successor, axis=1, stable=True)
    count = jnp.sum(graph.has_successor, axis=1).astype(jnp.int32)
    to_left, to_right = graph.has_left & graph.left_change, graph.has_right & graph.right_change
    goes_on = (to_left & (count[graph.left_link] > 0)) | (to_right & (count[graph.right_link] > 0))
    has_rival = graph.has_conflict & (graph.road_type == RoadType.JUNCTION)[:, None]
    return LaneTables(
        graph=graph,
        table=_table(graph, n_points).reshape(n_links * n_points, 7),
        successor=jnp.take_along_axis(graph.successor, order, axis=1).astype(jnp.int32),
        n_successors=count,
        curvature=jnp.max(jnp.abs(graph.curvature), axis=1),
        width=jnp.mean(jnp.sqrt(jnp.sum((graph.left - graph.right) ** 2, axis=-1)), axis=1),
        ends=(count == 0) & goes_on & graph.valid,
        rival=graph.conflict.astype(jnp.int32),
        has_rival=has_rival,
        edge=edge,
        ways=ways,
        n_points=n_points,
    )


def _table(graph: RoadGraph, n_points: int) -> Array:
    """[L, P, 7] columns at uniform stations; positions by cubic Hermite, the rest linear between the graph's points."""
    knots = graph.station.shape[1]
    where = jnp.linspace(0.0, knots - 1, n_points, dtype=graph.centre.dtype)
    index = jnp.clip(jnp.floor(where).astype(jnp.int32), 0, knots - 2)
    share = (where - index.astype(where.dtype))[None, :]

    def along(values: Array) -> Array:
        return values[:, index] * (1 - share) + values[:, index + 1] * share

    heading = along(graph.heading)
    begin, end, out, back = polynomial.hermite(share)
    spacing = (graph.station[:, 1:] - graph.station[:, :-1])[:, index]

    def hermite(values: Array, slope: Array) -> Array:
        bend = spacing * (out * slope[:, index] + back * slope[:, index + 1])
        return values[:, index] * begin + values[:, index + 1] * end + bend

    x = hermite(graph.centre[..., 0], jnp.cos(graph.heading))
    y = hermite(graph.centre[..., 1], jnp.sin(graph.heading))
    stations = graph.length[:, None] * (where / (knots - 1))[None, :]

    def beside(link: Array, station: Array) -> Array:
        """Signed distance to the point at `station` of the neighbour."""
        there_x = jax.vmap(jnp.interp)(station, stations[link], x[link])
        there_y = jax.vmap(jnp.interp)(station, stations[link], y[link])
        return (there_y - y) * jnp.cos(heading) - (there_x - x) * jnp.sin(heading)

    left, right = along(graph.left_station), along(graph.right_station)
    to_left, to_right = beside(graph.left_link, left), beside(graph.right_link, right)
    return jnp.stack([x, y, heading, left, to_left, right, to_right], axis=-1)


def take(values: Array, index: Array) -> Array:
    """values[index] for indices in range: without the wrap and the clamp of plain indexing, which add up.

    Args: values, of any shape; index, into the first axis.
    """
    return values.at[index].get(mode="promise_in_bounds", wrap_negative_indices=False)


def at(lanes: LaneTables, link: Int[Array, " n"], *, station: Float[Array, " n"]) -> Float[Array, "n 7"]:
    """Rows of the table at places, interpolated linearly and held beyond the ends.

    Args: lanes; link [N]; station [N] m, along it.
    """
    last = lanes.n_points - 1
    u = jnp.clip(station / take(lanes.graph.length, link), 0.0, 1.0) * last
    index = jnp.clip(jnp.floor(u), 0, last - 1).astype(jnp.int32)
    first = link * lanes.n_points + index
    share = (u - index.astype(u.dtype))[:, None]
    return take(lanes.table, first) * (1 - share) + take(lanes.table, first + 1) * share


def following(lanes: LaneTables, link: Int[Array, " n"], *, choice: Int[Array, " n"]) -> tuple[Int[Array, " n"], Array]:
    """Next link of a driver, and whether there is one.

    Args: lanes; link [N]; choice [N], of which the number of successors leaves the one that is taken.
    """
    count = take(lanes.n_successors, link)
    branches = lanes.successor.shape[1]
    follows = take(lanes.successor.reshape(-1), link * branches + choice % jnp.maximum(count, 1))
    return follows, count > 0


def place(lanes: LaneTables, link: Int[Array, " e"], *, position: Float[Array, "2"]) -> Projection:
    """A position projected on each link [e], its curvature left out; the station is held at the link's ends.

    Args: lanes; link [e]; position [2] m.
    """
    rows = lanes.table.reshape(-1, lanes.n_points, 7)[link]
    share = jnp.linspace(0.0, 1.0, lanes.n_points, dtype=rows.dtype)
    station = lanes.graph.length[link][:, None] * share[None, :]

    def project(row: Array, station: Array) -> Projection:
        flat = jnp.zeros_like(station)
        return polyline.project(row[:, :HEADING], position, station=station, heading=row[:, HEADING], curvature=flat)

    return jax.vmap(project)(rows, station)
