"""Responsibility-sensitive safety: the distances at which even the worst reply of the other leaves no collision.

Shalev-Shwartz, Shammah & Shashua 2017 (arXiv 1708.06374), lemmas 2 to 4. A situation is dangerous if the distance is
too small along *and* across the road. IEEE 2846 names the same bounds on the reasonably foreseeable motion of others
without values; the defaults are those of Intel's ad-rss-lib for a car.
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.traffic.safety.relative import relative
from urbanjax.types import Objects, pytree

ONCOMING = 0.1  # m/s, a slower approach of the other one counts as standing


@pytree
class RSSParams:
    """Bounds on how both vehicles behave; all positive. The shortest braking is harder than the mild ones."""

    response_time: float = 1.0  # s, rho, before either of them brakes
    max_acceleration: float = 3.5  # m/s^2, during the response
    max_braking: float = 8.0  # m/s^2, of the front vehicle; not less than min_braking
    min_braking: float = 4.0  # m/s^2, of the rear vehicle, or the one on the wrong side, after the response
    min_braking_correct: float = 3.0  # m/s^2, of a vehicle on its own side that meets one on the wrong side
    max_lateral_acceleration: float = 0.2  # m/s^2, towards each other during the response
    min_lateral_braking: float = 0.8  # m/s^2, after the response
    lateral_margin: float = 0.0  # m, mu, what fluctuations across the lane take


@pytree
class RSS:
    """How far two vehicles are from danger; inf and False where one is absent."""

    longitudinal: Array  # [*s] m, distance along the road less the least safe one
    lateral: Array  # [*s] m, distance across the road less the least safe one
    margin: Array  # [*s] m, the greater of the two
    dangerous: Array  # [*s] bool, the margin is negative: neither distance is safe


def same_direction_distance(
    rear_speed: Float[Array, "*b"], front_speed: Float[Array, "*b"], *, params: RSSParams
) -> Float[Array, "*b"]:
    """Least safe gap to a vehicle ahead [m], that drives the same way (lemma 2).

    max(0, v_r rho + a rho^2 / 2 + (v_r + a rho)^2 / (2 b_min) - v_f^2 / (2 b_max)): the rear one accelerates during its
    response and then brakes mildly, while the front one brakes hard at once.
    Args: rear_speed, front_speed [*b] m/s, not negative.
    """
    reply = _advance(rear_speed, params.max_acceleration, params.min_braking, params)
    return jnp.maximum(reply - front_speed**2 / (2 * params.max_braking), 0)


def opposite_direction_distance(
    speed: Float[Array, "*b"], oncoming_speed: Float[Array, "*b"], *, params: RSSParams
) -> Float[Array, "*b"]:
    """Least safe gap between vehicles that drive towards each other [m] (lemma 3).

    Both accelerate during their response and then brake mildly.
    Args: speed of the one on its own side, oncoming_speed of the one on the wrong side [*b] m/s, towards each other,
    not negative.
    """
    own = _advance(speed, params.max_acceleration, params.min_braking_correct, params)
    return own + _advance(oncoming_speed, params.max_acceleration, params.min_braking, params)


def lateral_distance(
    speed: Float[Array, "*b"], other_speed: Float[Array, "*b"], *, params: RSSParams
) -> Float[Array, "*b"]:
    """Least safe gap across the road [m] (lemma 4).

    Both accelerate towards each other during their response and then brake until they have no lateral speed. Of one
    that still moves away after its response the way of braking counts as away, a case that the lemma leaves out.
    Args: speed, other_speed [*b] m/s, lateral, of each towards the other; negative: away from it.
    """
    a, b = params.max_lateral_acceleration, params.min_lateral_braking
    return params.lateral_margin + jnp.maximum(_advance(speed, a, b, params) + _advance(other_speed, a, b, params), 0)


def _advance(speed: Array, acceleration: float | Array, braking: float | Array, params: RSSParams) -> Array:
    """Way made until standing [m]: accelerated during the response, braked after it."""
    after = speed + acceleration * params.response_time
    return (speed + after) / 2 * params.response_time + after * jnp.abs(after) / (2 * braking)


def rss(own: Objects, other: Objects, *, params: RSSParams) -> RSS:
    """Margins between two vehicles, with one's own heading as the direction of the road.

    Whoever is behind along it answers for the longitudinal distance; of two that drive towards each other one's own
    vehicle is held to be on its own side. A vehicle that reverses counts as standing for the same-direction rule, and
    an approach below 0.1 m/s as none. Not differentiable where the two are level, at that switch, or where a least
    distance is 0.
    Args: own, other, objects of broadcastable shapes [*s] of one rank.
    """
    view = relative(own, other)
    ahead = view.ahead >= 0
    rear = jnp.where(ahead, view.own_speed, view.speed_along)
    front = jnp.where(ahead, view.speed_along, view.own_speed)
    same = same_direction_distance(jnp.maximum(rear, 0), jnp.maximum(front, 0), params=params)
    mine, theirs = jnp.where(ahead, rear, -front), jnp.where(ahead, -front, rear)  # speeds towards each other
    opposite = opposite_direction_distance(jnp.maximum(mine, 0), jnp.maximum(theirs, 0), params=params)
    towards = -jnp.where(view.left >= 0, 1, -1) * view.speed_across
    longitudinal = view.gap - jnp.where(front < -ONCOMING, opposite, same)
    lateral = view.side_gap - lateral_distance(jnp.zeros_like(towards), towards, params=params)
    longitudinal, lateral = (jnp.where(view.valid, m, jnp.inf) for m in (longitudinal, lateral))
    margin = jnp.maximum(longitudinal, lateral)
    return RSS(longitudinal, lateral, margin, margin < 0)
