"""Car following: what a driver does behind a front vehicle, as an acceleration (IDM) or as a speed."""

from typing import ClassVar

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import lean
from urbanjax.types import POSITIVE, field, pytree, static
from urbanjax.vehicle.limits import MIN_SPEED

MIN_GAP = 0.1  # m, a smaller or negative gap counts as this one
MIN_RATIO = 1e-4  # of speed to desired speed: keeps the logarithm inside the power, and its derivative, finite


@pytree
class IDMParams:
    """Intelligent driver model (Treiber, Hennecke, Helbing 2000); gaps are bumper to bumper."""

    acceleration: float = field(default=1.5, metadata=POSITIVE)  # m/s^2, from standstill on a free road
    deceleration: float = field(default=2.0, metadata=POSITIVE)  # m/s^2, comfortable braking, positive
    time_headway: float = 1.2  # s
    jam_distance: float = 2.0  # m
    exponent: float = 4.0  # [-]
    floored: bool = static(default=True)  # the desired gap is never below the jam distance (False: as highway-env)


@pytree
class HeadwayParams:
    """Constant time headway."""

    PINNED: ClassVar[dict[str, str]] = {
        "time_headway": "safety: the gap that is kept on the move",
        "jam_distance": "safety: the gap that is kept at standstill",
    }

    time_headway: float = 1.2  # s
    jam_distance: float = 3.0  # m
    time_constant: float = field(default=1.5, metadata=POSITIVE)  # s, in which a gap error is to be closed


def highway_idm() -> IDMParams:
    """The parameters of highway-env's `IDMVehicle`, whose gaps are centre to centre."""
    return IDMParams(
        acceleration=3.0, deceleration=5.0, time_headway=1.5, jam_distance=10.0, exponent=4.0, floored=False
    )


def desired_gap(speed: Float[Array, "*b"], front_speed: Float[Array, "*b"], *, params: IDMParams) -> Float[Array, "*b"]:
    """Gap that IDM wants [m], s0 + v T + v (v - v_f) / (2 sqrt(a b)). Args: speed and front_speed [*B] m/s."""
    closing = speed * (speed - front_speed) / (2 * jnp.sqrt(params.acceleration * params.deceleration))
    dynamic = speed * params.time_headway + closing
    return params.jam_distance + (lean.maximum(dynamic, 0.0) if params.floored else dynamic)


def free_acceleration(
    speed: Float[Array, "*b"], desired_speed: Float[Array, "*b"], *, params: IDMParams
) -> Float[Array, "*b"]:
    """IDM's acceleration on a free road [m/s^2], a (1 - (v / v_0)^exponent). Args: speed and desired_speed [*B] m/s."""
    ratio = lean.maximum(speed / lean.maximum(jnp.abs(desired_speed), MIN_SPEED), MIN_RATIO)
    return params.acceleration * (1 - ratio**params.exponent)


def interaction(
    speed: Float[Array, "*b"], gap: Float[Array, "*b"], *, front_speed: Float[Array, "*b"], params: IDMParams
) -> Float[Array, "*b"]:
    """IDM's braking for a front vehicle [m/s^2], a (s* / s)^2, not negative; about 0 for a gap of 1e6 m.

    Args: speed [*B] m/s; gap [*B] m, bumper to bumper; front_speed [*B] m/s.
    """
    ratio = desired_gap(speed, front_speed, params=params) / lean.maximum(gap, MIN_GAP)
    return params.acceleration * ratio * ratio


def idm_acceleration(
    speed: Float[Array, "*b"],
    desired_speed: Float[Array, "*b"],
    *,
    gap: Float[Array, "*b"],
    front_speed: Float[Array, "*b"],
    params: IDMParams,
) -> Float[Array, "*b"]:
    """IDM acceleration [m/s^2], unlimited from below; without a front vehicle pass a gap of 1e6 m.

    Equal to highway-env's `IDMVehicle.acceleration` with `highway_idm()`, where the gap is measured centre to centre.
    Args: speed and desired_speed [*B] m/s; gap [*B] m, bumper to bumper; front_speed [*B] m/s.
    """
    return free_acceleration(speed, desired_speed, params=params) - interaction(
        speed, gap, front_speed=front_speed, params=params
    )


def constant_headway_speed(
    speed: Float[Array, "*b"],
    gap: Float[Array, "*b"],
    *,
    front_speed: Float[Array, "*b"],
    cap: Float[Array, "*b"],
    params: HeadwayParams,
) -> Float[Array, "*b"]:
    """Speed to drive behind a front vehicle [m/s], clip(v_f + (gap - s0 - T_h v) / t_c, 0, cap).

    These are v_T and v_E of Eq. 28, which the paper leaves open. Without a front vehicle pass a gap of 1e6 m. Args:
    speed [*B] m/s; gap [*B] m, bumper to bumper; front_speed [*B] m/s; cap [*B] m/s.
    """
    error = gap - params.jam_distance - params.time_headway * speed
    return jnp.clip(front_speed + error / params.time_constant, 0.0, cap)
