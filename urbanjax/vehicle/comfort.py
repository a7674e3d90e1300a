"""Whether a ride is comfortable, as nuPlan tells it."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool

from urbanjax.numerics.savgol import savgol_matrix
from urbanjax.types import VehicleState, pytree
from urbanjax.vehicle.params import VehicleParams

# Points of the windows in which parabolas (and for the second derivative cubics) are fitted; 0: all that there are.
ALL, ACCELERATIONS, HEADINGS = 0, 8, 5


@pytree
class ComfortParams:
    """Bounds within which a ride is comfortable; those of nuPlan."""

    acceleration: float = 2.40  # m/s^2, along
    deceleration: float = 4.05  # m/s^2, along, positive
    lateral: float = 4.89  # m/s^2
    jerk: float = 8.37  # m/s^3, of the acceleration's magnitude
    longitudinal_jerk: float = 4.13  # m/s^3
    yaw_rate: float = 0.95  # rad/s
    yaw_acceleration: float = 1.93  # rad/s^2


def comfortable(
    ride: VehicleState, vehicle: VehicleParams, *, period: float | Array, params: ComfortParams
) -> Bool[Array, "*b"]:
    """Whether rides stay within all bounds; accelerations and headings are smoothed as nuPlan smooths them.

    Args: ride [*b, T], states in equal steps of time; vehicle, for its wheelbase; period s, of a step.
    """
    along = ride.acceleration
    lateral = ride.speed**2 * jnp.tan(ride.steering) / vehicle.wheelbase
    size = jnp.hypot(along, lateral)

    def smooth(x: Array, window: int, *, order: int = 2, derivative: int = 0) -> Array:
        matrix = savgol_matrix(x.shape[-1], window or x.shape[-1], order=order, derivative=derivative)
        return x @ jnp.asarray(matrix.T, x.dtype) / period**derivative

    steady = smooth(along, ALL)
    sizes = (
        (smooth(lateral, ALL), params.lateral),
        (smooth(smooth(size, ACCELERATIONS), ALL, derivative=1), params.jerk),
        (smooth(smooth(along, ACCELERATIONS), ALL, derivative=1), params.longitudinal_jerk),
        (smooth(ride.heading, HEADINGS, derivative=1), params.yaw_rate),
        (smooth(ride.heading, HEADINGS, order=3, derivative=2), params.yaw_acceleration),
    )
    within = (steady < params.acceleration) & (steady > -params.deceleration)
    for values, bound in sizes:
        within = within & (jnp.abs(values) < bound)
    return jnp.all(within, axis=-1)
