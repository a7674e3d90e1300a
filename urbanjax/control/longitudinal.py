"""Longitudinal control: from a reference speed to an acceleration."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import lean
from urbanjax.types import pytree
from urbanjax.vehicle.driving import Driving


@pytree
class LongitudinalParams:
    """First-order tracking of the reference speed within comfortable limits."""

    time_constant: float = 0.6  # s
    comfort_acceleration: float = 2.0  # m/s^2
    comfort_deceleration: float = 4.0  # m/s^2, positive


def accelerate(
    speed: Float[Array, ""], driving: Driving, *, reference: Float[Array, ""], emergency: Float[Array, ""]
) -> Float[Array, ""]:
    """Acceleration in m/s^2: (reference - speed) / time constant, clipped; full braking as `emergency` goes to 1.

    Args: speed [] m/s; driving, with LongitudinalParams; reference [] m/s; emergency [], a share.
    """
    params, vehicle = driving.params, driving.vehicle
    upper = jnp.minimum(params.comfort_acceleration, vehicle.max_acceleration)
    lower = -jnp.minimum(params.comfort_deceleration, vehicle.max_deceleration)
    tracking = lean.clip((reference - speed) / params.time_constant, lower, upper)
    braking = lean.clip(-speed / params.time_constant, -vehicle.max_deceleration, 0.0)
    return (1 - emergency) * tracking + emergency * braking
