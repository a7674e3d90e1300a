"""Post-encroachment time: one vehicle has left a place, how long until another one comes there. Hard only.

Both measures take box footprints sampled every dt and are multiples of it. They exceed those of the continuous motion
by less than 2 dt, where samples of both vehicles cover the place: a vehicle should move by less than its length in dt.
"""

import jax
import jax.numpy as jnp
from jax import Array

from urbanjax.geometry.boxes import Box, box, box_gap
from urbanjax.types import Objects, pytree


@pytree
class ConflictArea:
    """When two vehicles are in the area that both of their paths cover; inf throughout if there is none."""

    enter: Array  # [2] s from the first sample, when each one first touches the area
    leave: Array  # [2] s, when each one last touches it
    pet: Array  # [] s, from the leave of the one to the enter of the other; negative if both are in it at once


def footprint(objects: Objects) -> Box:
    """The boxes of objects of any shape.

    Args: objects [*s].
    """
    return box(objects.position, objects.heading, length=objects.length, width=objects.width)


def post_encroachment_time(first: Objects, second: Objects, *, dt: float | Array, window: int) -> Array:
    """PET [] [s]: least time from when `first` covers a point of the plane until `second` covers that point.

    The definition of SSAM (Gettman & Head 2003), point by point: 0 in a collision, infinite if `second` never comes
    where `first` was, or later than window * dt. For a follower in the same lane it is about the time gap. The order
    counts: for either order take the smaller of two.
    Args: first, second, trajectories [T]; dt [s] between samples; window, samples looked ahead.
    """
    return _encroachment(footprint(first), first.valid, footprint(second), second.valid, dt, window)


def encroachments(tracks: Objects, dt: float | Array, *, window: int) -> Array:
    """`post_encroachment_time` of every ordered pair, [V, V] [s]: row leaves, column comes; diagonal inf.

    In memory there are T V gaps at a time.
    Args: tracks [T, V]; dt [s] between samples; window, samples looked ahead.
    """
    boxes, valid = footprint(tracks), tracks.valid

    def of_one(first: tuple[Box, Array]) -> Array:
        pairs = jax.vmap(lambda b, v: _encroachment(*first, b, v, dt, window), in_axes=1)
        return pairs(boxes, valid)

    by_vehicle = jax.tree.map(lambda x: jnp.moveaxis(x, 1, 0), (boxes, valid))
    found = jax.lax.map(of_one, by_vehicle)
    return jnp.where(jnp.eye(valid.shape[1], dtype=bool), jnp.inf, found)


def _encroachment(
    first: Box, first_valid: Array, second: Box, second_valid: Array, dt: float | Array, window: int
) -> Array:
    count = first_valid.shape[0]

    def meets(lag: Array) -> Array:
        later = jnp.arange(count) + lag
        inside = jnp.minimum(later, count - 1)
        moved = jax.tree.map(lambda x: x[inside], second)
        counts = first_valid & second_valid[inside] & (later < count)
        return jnp.any((box_gap(first, moved) <= 0) & counts)

    met = jax.lax.map(meets, jnp.arange(min(window, count - 1) + 1))
    return jnp.where(jnp.any(met), jnp.argmax(met).astype(first.x.dtype) * dt, jnp.inf)


def conflict_area(first: Objects, second: Objects, *, dt: float | Array) -> ConflictArea:
    """The times of two vehicles in the area covered by both of their paths (Allen, Shin & Cooper 1978).

    The area is all that one vehicle sweeps and the other one sweeps too, at any time of the sample. It suits crossing
    paths; of two that follow one lane the area is the whole lane, and of one that comes back it is one area still.
    Args: first, second, trajectories [T]; dt [s] between samples. In memory there are T gaps at a time.
    """
    a, b = footprint(first), footprint(second)

    def row(touched: Array, now: tuple[Box, Array]) -> tuple[Array, Array]:
        one, valid = now
        one = jax.tree.map(lambda x: x[None], one)
        meets = (box_gap(one, b) <= 0) & second.valid & valid
        return touched | meets, jnp.any(meets)

    second_in, first_in = jax.lax.scan(row, jnp.zeros_like(second.valid), (a, first.valid))
    inside = jnp.stack([first_in, second_in])
    time = jnp.arange(inside.shape[1], dtype=a.x.dtype)[None] * dt
    enter = jnp.min(jnp.where(inside, time, jnp.inf), axis=1)
    leave = jnp.max(jnp.where(inside, time, -jnp.inf), axis=1)
    exists = jnp.any(inside)
    pet = jnp.maximum(enter[1] - leave[0], enter[0] - leave[1])
    return ConflictArea(enter, jnp.where(exists, leave, jnp.inf), jnp.where(exists, pet, jnp.inf))
