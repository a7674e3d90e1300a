"""Who follows whom, where no lanes are known."""

import jax
import jax.numpy as jnp
from jax import Array

from urbanjax.traffic.safety.following import (
    required_deceleration,
    time_gap,
    time_headway,
    time_to_collision,
)
from urbanjax.traffic.safety.relative import relative
from urbanjax.types import Objects, pytree


@pytree
class Leaders:
    """The vehicle that each one follows."""

    index: Array  # [*b, V] int32
    exists: Array  # [*b, V] bool


@pytree
class Following:
    """One-dimensional measures of followers; inf (deceleration 0) where nobody is followed."""

    gap: Array  # [*s] m, bumper to bumper along the follower's heading
    ttc: Array  # [*s] s
    time_gap: Array  # [*s] s
    headway: Array  # [*s] s
    deceleration: Array  # [*s] m/s^2, DRAC
    exists: Array  # [*s] bool, both are present and the leader's centre is ahead


def nearest_ahead(objects: Objects) -> Leaders:
    """For each vehicle the nearest one in its way: straight ahead over the width of its own box.

    The other one's centre is ahead, its box overlaps the strip of one's own width along one's own heading, and its gap
    along that heading is the smallest. A bend is not followed; crossing and oncoming vehicles count. Hard.
    Args: objects [V].
    """
    n = objects.valid.shape[0]
    own, other = jax.tree.map(lambda x: x[:, None], objects), jax.tree.map(lambda x: x[None], objects)
    view = relative(own, other)
    in_way = view.valid & (view.ahead > 0) & (view.side_gap < 0) & ~jnp.eye(n, dtype=bool)
    gap = jnp.where(in_way, view.gap, jnp.inf)
    return Leaders(jnp.argmin(gap, axis=1).astype(jnp.int32), jnp.any(in_way, axis=1))


def follow(own: Objects, leader: Objects) -> Following:
    """The measures of `following` for boxes, along the follower's heading.

    It asks only that the leader's centre be ahead; whether it is in the way is the caller's choice (`nearest_ahead`).
    Args: own, leader, objects of broadcastable shapes [*s] of one rank.
    """
    view = relative(own, leader)
    exists = view.valid & (view.ahead > 0)
    front_length = 2 * view.reach_along - own.length
    gap, speed, front = view.gap, view.own_speed, view.speed_along
    return Following(
        gap=jnp.where(exists, gap, jnp.inf),
        ttc=jnp.where(exists, time_to_collision(gap, speed, front_speed=front), jnp.inf),
        time_gap=jnp.where(exists, time_gap(gap, speed), jnp.inf),
        headway=jnp.where(exists, time_headway(gap, speed, front_length=front_length), jnp.inf),
        deceleration=jnp.where(exists, required_deceleration(gap, speed, front_speed=front), 0),
        exists=exists,
    )
