"""Speeds that physics, comfort and the road permit."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import lean, safe

SHORTEST = 0.1  # m, in which one stops
AMPLE = 1.25  # of the deceleration that a stop takes: one who brakes with it arrives with ever less
MIN_SPEED = 1e-2  # m/s, below which a limit is as good as zero


def curve_speed(
    curvature: Float[Array, "*b"], lateral_acceleration: float | Array, *, cap: float | Array
) -> Float[Array, "*b"]:
    """Highest speed in a curve [m/s], min(cap, sqrt(a_lat / |kappa|)); the cap on a straight road.

    Args: curvature [*B] 1/m; lateral_acceleration [m/s^2]; cap [m/s].
    """
    bound = lean.maximum(cap, MIN_SPEED)
    return jnp.sqrt(lateral_acceleration / lean.maximum(jnp.abs(curvature), lateral_acceleration / (bound * bound)))


def stop_speed(
    distance: Float[Array, "*b"], deceleration: float | Array, *, reaction_time: float | Array = 0.0
) -> Float[Array, "*b"]:
    """Speed from which one can stop within a distance [m/s], 0 at and behind the stop.

    Solves d = v t_r + v^2 / (2 a). A reaction time above 0 bounds the derivative at the stop by 1 / t_r, where the
    plain square root would be infinitely steep; `safe` cuts it to 0 there. Args: distance [*B] m; deceleration [m/s^2],
    positive; reaction_time [s].
    """
    delay = deceleration * reaction_time
    return safe.sqrt(delay * delay + 2 * deceleration * lean.maximum(distance, 0.0)) - delay


def easy_stop_speed(
    speed: Float[Array, "*b"],
    distance: Float[Array, "*b"],
    *,
    deceleration: float | Array,
    reaction_time: float | Array,
    lag: float | Array,
) -> Float[Array, "*b"]:
    """Speed to ask for so as to stop within a distance [m/s], braking little harder than that takes from now on.

    `stop_speed`, but one who learns late of a stop does not brake in full at once. Args: speed [*B] m/s, the present
    one; distance [*B] m; deceleration [m/s^2], positive, of one who learns early; reaction_time [s]; lag [s], in which
    control follows what is asked for.
    """
    needed = speed * speed / (2 * lean.maximum(distance, SHORTEST))
    gentle = speed - AMPLE * needed * lag
    return lean.maximum(stop_speed(distance, deceleration, reaction_time=reaction_time), gentle)


def approach_speed(
    distance: Float[Array, "*b"], target_speed: Float[Array, "*b"], *, deceleration: float | Array
) -> Float[Array, "*b"]:
    """Speed from which one can reach `target_speed` within a distance [m/s], sqrt(v^2 + 2 a d).

    Args: distance [*B] m; target_speed [*B] m/s; deceleration [m/s^2], positive.
    """
    return safe.sqrt(target_speed * target_speed + 2 * deceleration * lean.maximum(distance, 0.0))


def stopping_distance(speed: Float[Array, "*b"], deceleration: float | Array) -> Float[Array, "*b"]:
    """Distance covered while braking to standstill [m], v^2 / (2 a).

    Args: speed [*B] m/s; deceleration [m/s^2], positive.
    """
    return speed * speed / (2 * deceleration)
