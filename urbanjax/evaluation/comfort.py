"""How a drive feels, in the six quantities and through the filters of nuPlan: one rule for all scores that ask.

Windows and orders are those that its functions are really called with: 8 and 2 for accelerations, 15 and 2 for jerks of
the accelerations so smoothed, 5 and 2 for the yaw rate, 5 and 3 for the yaw acceleration.
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int

from urbanjax.evaluation.facts import Facts
from urbanjax.numerics import safe
from urbanjax.numerics.savgol import savgol
from urbanjax.types import pytree
from urbanjax.vehicle.comfort import ComfortParams


@pytree
class Motion:
    """What comfort is told from, at T steps."""

    acceleration: Array  # [T] m/s^2, longitudinal
    speed: Array  # [T] m/s
    yaw_rate: Array  # [T] rad/s
    heading: Array  # [T] rad


@pytree
class Smoothed:
    """The six quantities by step, smoothed."""

    longitudinal: Array  # [T] m/s^2
    lateral: Array  # [T] m/s^2
    jerk: Array  # [T] m/s^3, of the magnitude of the acceleration
    longitudinal_jerk: Array  # [T] m/s^3
    yaw_rate: Array  # [T] rad/s
    yaw_acceleration: Array  # [T] rad/s^2


def motion(facts: Facts) -> Motion:
    """The motion of a drive. Args: facts [T], of it."""
    return Motion(facts.acceleration, facts.ego.speed, facts.yaw_rate, facts.ego.heading)


def period(facts: Facts) -> Float[Array, ""]:
    """Mean period [s] of a drive, 1 for one of a single step. Args: facts [T], of it."""
    n = jnp.sum(facts.alive)
    return jnp.where(n > 1, facts.duration - facts.time[0], 1) / jnp.maximum(n - 1, 1)


def smoothed(ride: Motion, n: Int[Array, ""], *, spacing: Array) -> Smoothed:
    """The quantities of the first n steps; what follows them means nothing.

    Args: ride [T], the motion; n [], how many steps count; spacing [] s, of the steps.
    """
    across = ride.speed * ride.yaw_rate
    magnitude = safe.norm(jnp.stack([ride.acceleration, across], axis=-1))
    turns = jnp.round((ride.heading[1:] - ride.heading[:-1]) / (2 * jnp.pi))
    heading = ride.heading - 2 * jnp.pi * jnp.concatenate([jnp.zeros_like(ride.heading[:1]), jnp.cumsum(turns)])

    def jerk(acceleration: Array) -> Array:
        steady = savgol(acceleration, jnp.maximum(n, 15), window=8, order=2)
        return savgol(steady, n, window=15, order=2, derivative=1, spacing=spacing)

    return Smoothed(
        longitudinal=savgol(ride.acceleration, n, window=8, order=2),
        lateral=savgol(across, n, window=8, order=2),
        jerk=jerk(magnitude),
        longitudinal_jerk=jerk(ride.acceleration),
        yaw_rate=savgol(heading, n, window=5, order=2, derivative=1, spacing=spacing),
        yaw_acceleration=savgol(heading, n, window=5, order=3, derivative=2, spacing=spacing),
    )


def room(steps: Smoothed, params: ComfortParams) -> Float[Array, "12 t"]:
    """Room left to both bounds of each quantity, in shares of the bound; positive within.

    Args: steps [T], the quantities; params, the bounds.
    """
    bounds = (
        (steps.longitudinal, -params.deceleration, params.acceleration),
        (steps.lateral, -params.lateral, params.lateral),
        (steps.jerk, -params.jerk, params.jerk),
        (steps.longitudinal_jerk, -params.longitudinal_jerk, params.longitudinal_jerk),
        (steps.yaw_rate, -params.yaw_rate, params.yaw_rate),
        (steps.yaw_acceleration, -params.yaw_acceleration, params.yaw_acceleration),
    )
    return jnp.stack([left for x, low, high in bounds for left in (1 - x / low, 1 - x / high)])
