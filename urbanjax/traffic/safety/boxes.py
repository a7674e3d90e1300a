"""Time to collision of two oriented boxes in the plane."""

import jax.numpy as jnp
from jax import Array

from urbanjax.traffic.safety.relative import STILL, relative
from urbanjax.types import Objects


def box_time_to_collision(own: Objects, other: Objects) -> Array:
    """Time until the boxes first touch [*s] [s], both at constant velocity along their heading and without turning.

    Exact: convex bodies touch while their shadows on every face normal do, and each of the four pairs of shadows
    overlaps during one interval of time. 0 while they overlap or touch, infinite if they never will or one is absent.
    Symmetric. Differentiable, but for a jump between a near miss and a graze, and kinks where two faces meet at once
    or the boxes are parallel or square; where it is 0 or infinite the derivative is 0.
    Args: own, other, objects of broadcastable shapes [*s] of one rank.
    """
    start, end, valid = jnp.zeros(()), jnp.asarray(jnp.inf), jnp.asarray(True)
    for view in (relative(own, other), relative(other, own)):
        for distance, speed, reach in (
            (view.ahead, view.speed_along - view.own_speed, view.reach_along),
            (view.left, view.speed_across, view.reach_across),
        ):
            enter, leave = _shadows_overlap(distance, speed, reach)
            start = jnp.maximum(jnp.broadcast_to(start, enter.shape), enter)
            end = jnp.minimum(jnp.broadcast_to(end, leave.shape), leave)
        valid = view.valid
    return jnp.where((start <= end) & valid, start, jnp.inf)


def _shadows_overlap(distance: Array, speed: Array, reach: Array) -> tuple[Array, Array]:
    """The interval of time in which |distance + speed t| <= reach, (inf, -inf) if empty."""
    moves = jnp.abs(speed) > STILL
    pace = jnp.where(moves, speed, 1)
    one, two = (-reach - distance) / pace, (reach - distance) / pace
    inside = jnp.abs(distance) <= reach
    enter = jnp.where(moves, jnp.minimum(one, two), jnp.where(inside, -jnp.inf, jnp.inf))
    leave = jnp.where(moves, jnp.maximum(one, two), jnp.where(inside, jnp.inf, -jnp.inf))
    return enter, leave
