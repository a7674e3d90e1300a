"""The lanes across a road, seen from points on one of them."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Float, Int

from urbanjax.roadmap.graph import RoadGraph
from urbanjax.roadmap.links import beside, foot
from urbanjax.types import pytree

TINY = 1e-6  # m^2, keeps a link whose ends meet from dividing by 0
OVERHANG = 1.5  # m beyond the end of a lane to which it still counts as beside a point
ADJACENT = (0.5, 1.6)  # times the lane width: lateral distance of an oncoming lane that is next to a lane
SAME_GROUND = 0.35  # times the lane width: lateral distance of an oncoming lane on the same ground


@pytree
class LanesAcross:
    """Q lanes at N points, from right (0) to left; lane Q // 2 is the one that the points are on."""

    offset: Array  # [N, Q] m from the point along its normal, left positive
    width: Array  # [N, Q] m
    link: Array  # [N, Q] int32
    has: Array  # [N, Q] bool
    oncoming: Array  # [N, Q] bool
    change: Array  # [N, Q - 1] bool, changing between lanes q and q + 1, away from lane Q // 2, is permitted


class _View(NamedTuple):
    """What the cross-section is seen from."""

    graph: RoadGraph
    position: Array  # [N, 2] m
    heading: Array  # [N] rad
    excess: Array  # [N] m, how far beyond its ends a lane still counts


class _Lane(NamedTuple):
    """One lane of the cross-section; all [N]."""

    link: Array
    station: Array
    offset: Array
    width: Array
    has: Array
    oncoming: Array
    same_way: Array  # driven in the direction of the points


def lanes_across(
    graph: RoadGraph,
    link: Int[Array, "n"],
    *,
    station: Float[Array, "n"],
    position: Float[Array, "n 2"],
    heading: Float[Array, "n"],
    lanes: int,
) -> LanesAcross:
    """The lanes that the normal to each heading [rad] at each position [m] crosses.

    Neighbours in the same direction, as far as they go, and beside the leftmost of them the nearest oncoming lane. A
    lane in the same direction whose ground an oncoming lane uses too is marked as oncoming. Where there is no lane,
    offset and width go on as if there were another one of the same width.
    Args: graph, the road graph; link and station [N] m, the lane that the points are on or near; position [N, 2] m;
    heading [N] rad; lanes, Q (odd).
    """
    beyond = jnp.maximum(jnp.maximum(station - graph.length[link], -station), 0)
    view = _View(graph, position, heading, beyond + OVERHANG)
    middle = _place(view, link, station, jnp.ones(link.shape, bool))
    levels, shared, permitted = _outward(view, middle, lanes // 2)

    def row(x: Array) -> Array:
        """[N, Q] from the levels [Q // 2 + 1, 2, N] of both sides."""
        return jnp.concatenate([x[:0:-1, 0], x[:, 1]]).T

    return LanesAcross(
        offset=row(levels.offset),
        width=row(levels.width),
        link=row(levels.link),
        has=row(levels.has),
        oncoming=row(levels.oncoming | shared),
        change=jnp.concatenate([permitted[-2::-1, 0], permitted[:-1, 1]]).T,
    )


def _place(view: _View, link: Array, guess: Array, has: Array) -> _Lane:
    """A link where the normals meet it; there only within its ends."""
    at = foot(view.graph, link, guess=guess, position=view.position, heading=view.heading)
    has = has & (at.station > -view.excess) & (at.station < view.graph.length[link] + view.excess)
    return _Lane(link, at.station, at.offset, at.width, has, oncoming=jnp.zeros_like(has), same_way=has)


def _oncoming(view: _View, lane: _Lane) -> tuple[_Lane, Array]:
    """The nearest oncoming lane on the left of a lane, and whether there is one on the lane's own ground."""
    graph, other = view.graph, view.graph.opposite[lane.link]
    start = graph.centre[other, 0]
    chord = graph.centre[other, -1] - start
    share = jnp.sum((view.position[:, None] - start) * chord, -1) / jnp.maximum(jnp.sum(chord * chord, -1), TINY)
    position = jnp.broadcast_to(view.position[:, None], chord.shape)
    heading = jnp.broadcast_to(view.heading[:, None], share.shape)
    at = foot(graph, other, guess=jnp.clip(share, 0, 1) * graph.length[other], position=position, heading=heading)
    inside = (at.station > -view.excess[:, None]) & (at.station < graph.length[other] + view.excess[:, None])
    there = graph.has_opposite[lane.link] & inside & lane.same_way[:, None]
    aside = (at.offset - lane.offset[:, None]) / lane.width[:, None]
    adjacent = there & (aside > ADJACENT[0]) & (aside < ADJACENT[1])
    k = jnp.argmin(jnp.where(adjacent, aside, jnp.inf), axis=1)[:, None]
    nearest = (jnp.take_along_axis(x, k, axis=1)[:, 0] for x in (other, at.station, at.offset, at.width))
    found = jnp.any(adjacent, axis=1)
    shared = jnp.any(there & (jnp.abs(aside) < SAME_GROUND), axis=1)
    return _Lane(*nearest, has=found, oncoming=found, same_way=jnp.zeros_like(found)), shared


def _outward(view: _View, middle: _Lane, count: int) -> tuple[_Lane, Array, Array]:
    """The lanes from the middle outwards, [count + 1, 2, N] for the right (0) and the left (1) side.

    With them: whether oncoming traffic shares their ground, and whether one may change to the next lane outwards.
    """
    graph = view.graph

    def outward(lane: _Lane, left: Array) -> tuple[_Lane, tuple[_Lane, Array, Array]]:
        sides = ((graph.left_link, graph.right_link), (graph.has_left, graph.has_right))
        neighbour, has = (jnp.where(left, a[lane.link], b[lane.link]) for a, b in sides)
        guess = beside(graph, lane.link, station=lane.station, left=jnp.broadcast_to(left, lane.has.shape))
        beside_it = _place(view, neighbour, guess, has & lane.same_way)
        against, shared = _oncoming(view, lane)
        no = jnp.zeros_like(lane.has)
        further = lane.offset + jnp.where(left, lane.width, -lane.width)
        following = lane._replace(offset=further, has=no, oncoming=no, same_way=no)
        following = _select(against.has & left, against, following)
        following = _select(beside_it.has, beside_it, following)
        permitted = jnp.where(left, graph.left_change[lane.link], graph.right_change[lane.link])
        return following, (lane, shared, following.has & permitted)

    start = jax.tree.map(lambda x: jnp.stack([x, x]), middle)
    step = jax.vmap(outward, in_axes=(0, 0))
    return lax.scan(lambda lanes, _: step(lanes, jnp.array([False, True])), start, length=count + 1)[1]


def _select(which: Array, a: _Lane, b: _Lane) -> _Lane:
    return _Lane(*(jnp.where(which, x, y) for x, y in zip(a, b, strict=True)))
