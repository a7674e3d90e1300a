"""The reference line of a route: link after link, with a smooth lateral blend where the route changes lanes."""

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Float

from urbanjax.geometry import frenet
from urbanjax.numerics import polynomial, safe
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.roadmap.links import beside, foot, sample
from urbanjax.roadmap.route import Route
from urbanjax.types import pytree

SHORTEST = 1e-3  # m, of a lane change: keeps its slope finite
STEEPEST = 1.0  # rad between two lanes up to which the one drifts from the other


@pytree
class Walk:
    """What the reference line covers of each link of the route. Its parameter u [m] is the sum of the parts covered.

    A link that the route leaves by a lane change shares its length with the links of the following changes; the last
    one of them then covers nothing more, since all of them lie side by side.
    """

    link: Array  # [R] int32
    following: Array  # [R] int32, the next link
    change: Array  # [R] bool, the next link is entered by a lane change
    left: Array  # [R] bool, to the left
    start: Array  # [R] m, station on the link where its part begins
    part: Array  # [R] m, its length
    begin: Array  # [R] m, u where it begins
    last: Array  # [] int32, index of the goal
    total: Array  # [] m, u at the end of the route


@pytree
class ReferenceRow:
    """The reference line at N values of u."""

    entry: Array  # [N] int32, index into the walk
    station: Array  # [N] m, on the link of that entry
    weight: Array  # [N] how far the lane change has come, 0 to 1
    following_station: Array  # [N] m, on the following link, beside
    position: Array  # [N, 2] m
    heading: Array  # [N] rad, not unwrapped from link to link
    curvature: Array  # [N] 1/m
    speed: Array  # [N] metres of reference line per metre of u


def walk(graph: RoadGraph, route: Route) -> Walk:
    """The parts of the links that make up the reference line. Args: graph, the road graph; route, through it."""
    following = jnp.concatenate([route.link[1:], route.link[-1:]])
    change = route.change & route.valid
    left = graph.has_left[route.link] & (graph.left_link[route.link] == following)

    def count(after: Array, changes: Array) -> tuple[Array, Array]:
        now = jnp.where(changes, after + 1, 0)
        return now, now

    _, to_come = lax.scan(count, jnp.zeros((), jnp.int32), change, reverse=True)

    def cover(start: Array, entry: tuple[Array, ...]) -> tuple[Array, tuple[Array, Array]]:
        link, changes, to_left, remaining = entry
        rest = graph.length[link] - start
        part = jnp.where(changes, rest / jnp.maximum(remaining, 1).astype(rest.dtype), rest)
        then = jnp.where(changes, beside(graph, link, station=start + part, left=to_left), 0)
        return then, (start, part)

    _, (start, part) = lax.scan(cover, jnp.zeros_like(graph.length[0]), (route.link, change, left, to_come))
    part = jnp.where(route.valid, jnp.maximum(part, 0), 0)
    end = jnp.cumsum(part)
    last = jnp.maximum(jnp.sum(route.valid) - 1, 0)
    return Walk(route.link, following, change, left, start, part, end - part, last, end[-1])


def rows(graph: RoadGraph, path: Walk, *, u: Float[Array, "n"], blend_length: float | Float[Array, ""]) -> ReferenceRow:
    """The reference line at each u [m]; beyond the end of the route it goes straight on.

    A lane change takes `blend_length` metres (less where its part of the link is shorter) in the middle of that part,
    as a quintic smoothstep of the lateral offset from the lane that is left.
    Args: graph, the road graph; path, the parts of its links; u [N] m; blend_length [] m.
    """
    end = path.begin + path.part
    r = jnp.minimum(jnp.searchsorted(end, u, side="right"), path.last)
    link, other, change = path.link[r], path.following[r], path.change[r]
    along = u - path.begin[r]
    station = path.start[r] + along
    reach = jnp.maximum(jnp.minimum(blend_length, path.part[r]), SHORTEST)
    t = jnp.where(change, jnp.clip((along - path.part[r] / 2) / reach + 0.5, 0, 1), 0)
    weight = polynomial.smoother_step(t)
    slope = 30 * (t * (1 - t)) ** 2 / reach
    bend = 60 * t * (1 - t) * (1 - 2 * t) / reach**2

    here = sample(graph, link, station=station)
    there = foot(
        graph,
        other,
        guess=beside(graph, link, station=station, left=path.left[r]),
        position=here.position,
        heading=here.heading,
    )
    away = jnp.where(change, there.offset, 0)
    turned = safe.wrap_angle(there.heading - here.heading)
    drift = jnp.where(change, jnp.tan(jnp.clip(turned, -STEEPEST, STEEPEST)) * (1 - here.curvature * away), 0)
    offset, offset_slope = weight * away, slope * away + weight * drift
    heading, curvature = frenet.offset_curve(
        here.heading, here.curvature, offset=offset, slope=offset_slope, bend=bend * away + 2 * slope * drift
    )
    return ReferenceRow(
        entry=r,
        station=station,
        weight=weight,
        following_station=there.station,
        position=frenet.to_world(frenet.Reference(here.position, here.heading, here.curvature), offset),
        heading=heading,
        curvature=curvature,
        speed=frenet.offset_length(here.curvature, offset, slope=offset_slope),
    )


def unwrapped(heading: Float[Array, "n"]) -> Float[Array, "n"]:
    """Headings [rad] without jumps of 2 pi; whole turns are counted as integers, so no rounding builds up.

    Args: heading [N] rad.
    """
    turns = jnp.round((heading[:-1] - heading[1:]) / (2 * jnp.pi)).astype(jnp.int32)
    return heading + 2 * jnp.pi * jnp.pad(jnp.cumsum(turns), (1, 0)).astype(heading.dtype)
