"""Places on links: from (link, station) to the plane, with a constant number of look-ups per query."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int

from urbanjax.roadmap.graph import RoadGraph
from urbanjax.types import pytree


@pytree
class LinkPoint:
    """Points on the centre lines of links."""

    position: Array  # [*q, 2] m
    heading: Array  # [*q] rad
    curvature: Array  # [*q] 1/m
    width: Array  # [*q] m, between the borders


def sample(graph: RoadGraph, link: Int[Array, "*q"], station: Float[Array, "*q"]) -> LinkPoint:
    """The centre line of each link at each station [m]; beyond its ends a link goes straight on.

    The position is the cubic Hermite curve of the tabulated positions and headings; the rest is linear. Continuous and
    differentiable in the station.
    """
    last = graph.centre.shape[1] - 1
    step = graph.length[link] / last
    steps = station / step
    inside = jnp.clip(steps, 0, last)
    k = jnp.clip(jnp.floor(inside).astype(int), 0, last - 1)
    f = inside - k
    h0, h1 = graph.heading[link, k], graph.heading[link, k + 1]
    heading = h0 * (1 - f) + h1 * f

    def direction(angle: Array) -> Array:
        return jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)

    g = f[..., None]
    end = g * g * (3 - 2 * g)
    bend = g * (1 - g) * ((1 - g) * direction(h0) - g * direction(h1))
    position = (1 - end) * graph.centre[link, k] + end * graph.centre[link, k + 1] + step[..., None] * bend
    beyond = (steps - inside) * step
    across = [jnp.hypot(*jnp.moveaxis(graph.left[link, i] - graph.right[link, i], -1, 0)) for i in (k, k + 1)]
    return LinkPoint(
        position=position + beyond[..., None] * direction(heading),
        heading=heading,
        curvature=graph.curvature[link, k] * (1 - f) + graph.curvature[link, k + 1] * f,
        width=across[0] * (1 - f) + across[1] * f,
    )


def foot(
    graph: RoadGraph,
    link: Int[Array, "*q"],
    guess: Float[Array, "*q"],
    position: Float[Array, "*q 2"],
    heading: Float[Array, "*q"],
    iterations: int = 3,
) -> tuple[Float[Array, "*q"], Float[Array, "*q"]]:
    """Where the normal to each heading [rad] at each position [m] meets each link: station [m] and offset [m].

    The station may lie beyond the ends of the link; the offset is positive where the link is on the left. Newton's
    method from `guess` [m]; for lanes that run along or against the heading.
    """
    tangent = jnp.stack([jnp.cos(heading), jnp.sin(heading)], axis=-1)
    normal = jnp.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)
    station = guess
    for _ in range(iterations):
        point = sample(graph, link, station)
        slope = jnp.cos(point.heading - heading)
        slope = jnp.where(slope < 0, -1, 1) * jnp.maximum(jnp.abs(slope), 0.2)
        station = station + jnp.sum((position - point.position) * tangent, axis=-1) / slope
    away = sample(graph, link, station).position - position
    return station, jnp.sum(away * normal, axis=-1)
