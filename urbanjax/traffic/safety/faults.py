"""When a vehicle's planned ways first lead to a collision that is its fault, and when too near to one.

Whose fault a contact is, is told as nuPlan tells it: not that of one who stands or who is hit from behind; else that of
one who hits what stands, hits with its front, or, being between lanes or off the road, with its side.
"""

import math

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.geometry.boxes import Box, box, box_gap
from urbanjax.types import Objects, pytree


@pytree
class BlameParams:
    """When somebody stands, is ahead or behind, and how far a near collision is looked for; as in PDM-Closed."""

    still: float = 0.05  # m/s, up to which a vehicle stands in a collision
    creeping: float = 0.005  # m/s, below which one's own vehicle comes near to nobody
    cone: float = math.pi / 6  # rad, off one's axis, within which somebody is ahead or behind
    looks: tuple[float, ...] = (0.0, 0.3, 0.6, 0.9)  # s, for which boxes go straight on to find a near collision


def forecast(objects: Objects, times: Float[Array, " t"]) -> Objects:
    """Objects [T, O] at some times, at constant speed and heading. Args: objects [O]; times [T] s from now."""
    along = jnp.stack([jnp.cos(objects.heading), jnp.sin(objects.heading)], axis=-1)
    velocity = objects.speed[:, None] * along
    way = times[:, None, None] * velocity[None]
    every = jax.tree.map(lambda x: jnp.broadcast_to(x, (*times.shape, *x.shape)), objects)
    return every.replace(position=every.position + way)


def touching(own: Objects, others: Objects) -> Bool[Array, "*s"]:
    """Whether boxes share a point, and both are there. Args: own, others, of shapes [*s] that broadcast."""
    return (box_gap(_box(own), _box(others)) <= 0) & own.valid & others.valid


def first_infractions(
    own: Objects,
    others: Objects,
    *,
    times: Float[Array, " t"],
    apart: Bool[Array, "p t"],
    axle: float | Array,
    params: BlameParams,
) -> tuple[Float[Array, " p"], Float[Array, " p"]]:
    """When each of P ways first touches somebody by its own fault, and first is too near to it [s]; infinite if never.

    Whom a way has touched without fault counts no more. Too near: everybody going straight on from that time, at its
    speed, boxes would soon touch; who is ahead is asked of that time, as nuPlan's metric asks it, and between lanes and
    off the road whoever is not behind counts, too.
    Args: own [P, T], the ways; others [T, O]; times [T] s; apart [P, T], whether the vehicle is then between lanes or
    off the road; axle m, of its rear axle behind its centre, from which ahead and behind are seen.
    """
    mine, them = _pairs(own, others)
    there, aside = others.valid[None, :, None], apart[:, :, None, None]
    pace, speed = own.speed[:, :, None, None], others.speed[None, :, None]
    ahead, behind = _ahead_behind(mine, them, axle, params)
    forward = mine.half_length
    front = mine.replace(x=mine.x + forward * mine.cos, y=mine.y + forward * mine.sin, half_length=0 * forward)
    hits = (jnp.abs(speed) <= params.still) | (~behind & ((box_gap(front, them) <= 0) | aside))
    touch = (box_gap(mine, them) <= 0) & there
    looks = jnp.asarray(params.looks, times.dtype)[None, None, :, None]
    meets = (box_gap(_moved(mine, pace * looks), _moved(them, speed * looks)) <= 0) & there & (pace >= params.creeping)
    return (
        _first(touch, hits & (pace > params.still), times),
        _first(meets, ahead | (aside & ~behind), times),
    )


def _box(objects: Objects) -> Box:
    return box(objects.position, objects.heading, length=objects.length, width=objects.width)


def _pairs(own: Objects, others: Objects) -> tuple[Box, Box]:
    """Boxes of ways [P, T, 1, 1] and of others [1, T, 1, O]; the third axis is that of looks ahead."""
    mine, them = _box(own), _box(others)
    return jax.tree.map(lambda x: x[:, :, None, None], mine), jax.tree.map(lambda x: x[None, :, None], them)


def _moved(box: Box, way: Array) -> Box:
    """Boxes `way` m further along their heading."""
    return box.replace(x=box.x + way * box.cos, y=box.y + way * box.sin)


def _ahead_behind(own: Box, other: Box, axle: float | Array, params: BlameParams) -> tuple[Array, Array]:
    """Whether the other's centre is ahead, and whether it is behind, seen from one's rear axle."""
    x, y = other.x - own.x, other.y - own.y
    along, aside = x * own.cos + y * own.sin + axle, y * own.cos - x * own.sin
    reach = jnp.cos(params.cone) * jnp.hypot(along, aside)
    return along > reach, along < -reach


def _first(meets: Array, counts: Array, times: Array) -> Array:
    """The first of the times at which each way meets somebody who counts and was not met before without counting.

    Args: meets, counts [P, T, K, O], looked at in the order of T and then K; times [T] s.
    """
    n, k = meets.shape[1:3]
    order = jnp.arange(n * k, dtype=jnp.int32).reshape(1, n, k, 1)

    def begin(happens: Array) -> Array:
        return jnp.min(jnp.where(happens, order, n * k), axis=(1, 2))

    counted, excused = begin(meets & counts), begin(meets & ~counts)
    first = jnp.min(jnp.where(counted < excused, counted, n * k), axis=-1)
    return jnp.append(jnp.repeat(times, k), jnp.inf)[first]
