"""Places on links: from (link, station) to the plane, with a constant number of look-ups per query."""

from typing import Any

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Bool, Float, Int

from urbanjax.geometry import frenet
from urbanjax.numerics import lean, safe
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.types import pytree

LEAST_SLOPE = 0.2  # cosine between normal and link below which Newton's method takes shorter steps


@pytree
class LinkPoint:
    """Points on the centre lines of links."""

    position: Array  # [*q, 2] m
    heading: Array  # [*q] rad
    curvature: Array  # [*q] 1/m
    width: Array  # [*q] m, between the borders


@pytree
class Foot:
    """Where normals meet links."""

    station: Array  # [*q] m
    offset: Array  # [*q] m from the point along its normal, left positive
    heading: Array  # [*q] rad, of the link there
    width: Array  # [*q] m, of the link there


@pytree
class Projected:
    """Nearest places on links."""

    station: Array  # [*q] m
    offset: Array  # [*q] m, lateral, left positive
    heading: Array  # [*q] rad, of the link there
    distance: Array  # [*q] m, more than |offset| beyond the ends


def sample(graph: RoadGraph, link: Int[Array, "*q"], *, station: Float[Array, "*q"]) -> LinkPoint:
    """The centre line of each link at each station [m]; beyond its ends a link goes straight on.

    The position is the cubic Hermite curve of the tabulated positions and headings; the rest is linear. Continuous and
    differentiable in the station.
    Args: graph, the road graph; link [*q]; station [*q] m.
    """
    return _sample(*_nodes(graph, link), station)


def _nodes(graph: RoadGraph, link: Array) -> tuple[Array, Array, Array]:
    """All that is read of links, as one table [l, P, 5], because look-ups cost by the number, not by the size.

    With it the length [l] of its links, and the row of each query; few queries get a table of their own links only.
    """
    own = link.ravel()
    fields, row = (graph.centre, graph.left, graph.right, graph.heading, graph.curvature, graph.length), link
    if own.size < graph.length.shape[0]:
        fields = tuple(lean.rows(x, own) for x in fields)
        row = jnp.arange(own.size, dtype=jnp.int32).reshape(link.shape)
    centre, left, right, heading, curvature, length = fields
    beside = (heading, curvature, safe.norm(left - right))
    return jnp.concatenate([centre, *(x[..., None] for x in beside)], axis=-1), length, row


def _sample(nodes: Array, length: Array, link: Array, station: Array) -> LinkPoint:
    n_points = nodes.shape[1]
    step = lean.rows(length, link) / (n_points - 1)
    index, fraction, beyond = frenet.cell(0.0, step, n=n_points, station=station)
    rows, first = nodes.reshape(-1, nodes.shape[-1]), link * n_points + index
    at = frenet.read(frenet.Cell(lean.rows(rows, first), lean.rows(rows, first + 1), fraction, beyond, step))
    curvature, width = jnp.unstack(at.others, axis=-1)
    return LinkPoint(at.position, at.heading, curvature, width)


def foot(
    graph: RoadGraph,
    link: Int[Array, "*q"],
    *,
    guess: Float[Array, "*q"],
    position: Float[Array, "*q 2"],
    heading: Float[Array, "*q"],
    iterations: int = 4,
) -> Foot:
    """Where the normal to each heading [rad] at each position [m] meets each link.

    Newton's method from the station `guess` [m]; for lanes that run along or against the heading. The foot may lie
    beyond the ends of the link, which goes straight on there.
    Args: graph, the road graph; link [*q]; guess [*q] m; position [*q, 2] m; heading [*q] rad; iterations of the
    search.
    """
    table = _nodes(graph, link)
    tangent = jnp.stack([jnp.cos(heading), jnp.sin(heading)], axis=-1)
    normal = jnp.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)

    # A loop of one look-up: unrolled, or with one more after it, it would take several times as long to compile.
    def improve(_: Any, now: Foot) -> Foot:
        point = _sample(*table, now.station)
        slope = jnp.cos(point.heading - heading)
        slope = jnp.where(slope < 0, -1, 1) * jnp.maximum(jnp.abs(slope), LEAST_SLOPE)
        away = point.position - position
        station = now.station - jnp.sum(away * tangent, axis=-1) / slope
        return Foot(station, jnp.sum(away * normal, axis=-1), point.heading, point.width)

    return lax.fori_loop(0, iterations, improve, Foot(guess, guess, guess, guess))


def project(
    graph: RoadGraph,
    link: Int[Array, "*q"],
    *,
    guess: Float[Array, "*q"],
    position: Float[Array, "*q 2"],
    iterations: int = 4,
) -> Projected:
    """The nearest place to each position [m] on each link, by Newton's method from the station `guess` [m].

    The station stays within the ends of the link; differentiable in the position.
    Args: graph, the road graph; link [*q]; guess [*q] m; position [*q, 2] m; iterations of the search.
    """
    table, end = _nodes(graph, link), graph.length[link]

    def improve(_: Any, now: tuple[Array, Projected]) -> tuple[Array, Projected]:
        station, _ = now
        point = _sample(*table, station)
        cos, sin = jnp.cos(point.heading), jnp.sin(point.heading)
        x, y = position[..., 0] - point.position[..., 0], position[..., 1] - point.position[..., 1]
        along, aside = cos * x + sin * y, cos * y - sin * x
        found = Projected(station, aside, point.heading, safe.sqrt(along**2 + aside**2))
        step = along / frenet.scale(point.curvature, aside)
        return lean.clip(station + step, 0.0, end), found

    return lax.fori_loop(0, iterations, improve, (guess, Projected(guess, guess, guess, guess)))[1]


def beside(
    graph: RoadGraph, link: Int[Array, "*q"], *, station: Float[Array, "*q"], left: Bool[Array, "*q"]
) -> Float[Array, "*q"]:
    """Station [m] on the left (or else right) neighbour beside each station [m], from the graph's station maps.

    Args: graph, the road graph; link [*q]; station [*q] m on it; left [*q], which side is meant.
    """
    last = graph.centre.shape[1] - 1
    steps = jnp.clip(station * last / graph.length[link], 0, last)
    k = jnp.clip(jnp.floor(steps).astype(int), 0, last - 1)
    f = steps - k.astype(steps.dtype)
    a, b = (jnp.where(left, graph.left_station[link, i], graph.right_station[link, i]) for i in (k, k + 1))
    return a * (1 - f) + b * f
