"""One-dimensional measures of a follower behind a leader, from the gap between their bumpers.

A gap of 0 (below 1e-6 m) or less is contact. Away from contact and from equal speeds every measure is differentiable;
on the side where it is 0 or infinite its derivative is 0.
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.traffic.safety.relative import STILL

TOUCH = 1e-6  # m, a smaller gap is contact: the measures and their derivatives stay within float32


def time_to_collision(
    gap: Float[Array, "*b"], speed: Float[Array, "*b"], *, front_speed: Float[Array, "*b"]
) -> Float[Array, "*b"]:
    """TTC [s], gap / (v - v_f): infinite unless the gap closes, 0 in contact (Hayward 1972).

    Args: gap [*b] m, bumper to bumper; speed, front_speed [*b] m/s, both along the follower's way (oncoming: negative).
    """
    closing = speed - front_speed
    return jnp.where(gap > TOUCH, _over(gap, closing), 0)


def time_gap(gap: Float[Array, "*b"], speed: Float[Array, "*b"]) -> Float[Array, "*b"]:
    """Time from the leader's rear bumper to the follower's front one past one point [s], gap / v.

    Infinite for a follower that stands or reverses, 0 in contact.
    Args: gap [*b] m, bumper to bumper; speed [*b] m/s, the follower's.
    """
    return jnp.where(gap > TOUCH, _over(gap, speed), 0)


def time_headway(
    gap: Float[Array, "*b"], speed: Float[Array, "*b"], *, front_length: Float[Array, "*b"]
) -> Float[Array, "*b"]:
    """THW [s], front bumper to front bumper past one point, (gap + l_f) / v.

    Infinite for a follower that stands or reverses; never negative.
    Args: gap [*b] m, bumper to bumper; speed [*b] m/s, the follower's; front_length [*b] m, the leader's length.
    """
    return _over(jnp.maximum(gap + front_length, 0), speed)


def required_deceleration(
    gap: Float[Array, "*b"], speed: Float[Array, "*b"], *, front_speed: Float[Array, "*b"]
) -> Float[Array, "*b"]:
    """DRAC [m/s^2], (v - v_f)^2 / (2 gap): what just avoids the crash while the leader keeps its speed (Almqvist 1991).

    0 unless the gap closes, infinite in contact.
    Args: gap [*b] m, bumper to bumper; speed, front_speed [*b] m/s, both along the follower's way.
    """
    closing = jnp.maximum(speed - front_speed, 0)
    apart = gap > TOUCH
    return jnp.where(apart, closing * closing / (2 * jnp.where(apart, gap, 1)), jnp.inf)


def _over(distance: Array, speed: Array) -> Array:
    """Distance / speed, infinite where the speed is not positive."""
    moves = speed > STILL
    return jnp.where(moves, distance / jnp.where(moves, speed, 1), jnp.inf)
