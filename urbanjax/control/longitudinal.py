"""Longitudinal control: from a reference speed to an acceleration."""

from typing import ClassVar

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import lean
from urbanjax.types import POSITIVE, field, pytree
from urbanjax.vehicle.driving import Driving


@pytree
class LongitudinalParams:
    """First-order tracking of the reference speed within comfortable limits."""

    PINNED: ClassVar[dict[str, str]] = {
        "comfort_deceleration": "safety: all braking but that of emergencies is held to it",
        "max_jerk": "safety: how soon it brakes",
        "easy_jerk": "safety: how soon it brakes",
    }

    time_constant: float = field(default=0.6, metadata=POSITIVE)  # s
    comfort_acceleration: float = 2.0  # m/s^2
    comfort_deceleration: float = 4.0  # m/s^2, positive
    max_jerk: float = 8.0  # m/s^3, outside emergencies
    easy_jerk: float = 4.0  # m/s^3, the same as long as what is asked for is no more than comfortable deceleration
    release: float = field(default=2.0, metadata=POSITIVE)  # m/s^2, of braking too hard, from which it is faster, too
    onset_jerk: float = 1.5  # m/s^3, with which it speeds up; to brake, and to brake less hard, it may be faster


def accelerate(
    speed: Float[Array, ""],
    driving: Driving,
    *,
    previous: Float[Array, ""],
    reference: Float[Array, ""],
    emergency: Float[Array, ""],
) -> Float[Array, ""]:
    """Acceleration in m/s^2: (reference - speed) / time constant, clipped; full braking as `emergency` goes to 1.

    Outside emergencies it changes by no more than `easy_jerk` allows, and up to `max_jerk` where more than comfortable
    deceleration is asked for or it brakes far harder than that; beyond 0 it rises by `onset_jerk`. Args: speed [] m/s;
    driving, with LongitudinalParams; previous [] m/s^2, the present acceleration; reference [] m/s; emergency [], a
    share.
    """
    params, vehicle = driving.params, driving.vehicle
    upper = jnp.minimum(params.comfort_acceleration, vehicle.max_acceleration)
    lower = -jnp.minimum(params.comfort_deceleration, vehicle.max_deceleration)
    asked = (reference - speed) / params.time_constant
    wanted = lean.clip(asked, lower, upper)
    hurry = lean.clip(asked / lower - 1, 0.0, 1.0)
    release = lean.clip((wanted - previous) / params.release - 1, 0.0, 1.0)
    more = lean.maximum(params.max_jerk - params.easy_jerk, 0.0)
    change, rise = ((params.easy_jerk + share * more) * driving.period for share in (hurry, release))
    onset = lean.maximum(previous, 0) + params.onset_jerk * driving.period
    tracking = lean.clip(wanted, previous - change, lean.minimum(previous + rise, onset))
    braking = lean.clip(-speed / params.time_constant, -vehicle.max_deceleration, 0.0)
    return (1 - emergency) * tracking + emergency * braking
