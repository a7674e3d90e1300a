"""Car following: what a driver does behind a front vehicle, as an acceleration (IDM) or as a speed."""

from typing import ClassVar

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import lean
from urbanjax.types import POSITIVE, field, pytree, static
from urbanjax.vehicle.limits import AMPLE, MIN_SPEED, SHORTEST, stop_speed

MIN_GAP = 0.1  # m, a smaller or negative gap counts as this one
SLOW = 2.0  # m/s, below which one who leads is nobody who cuts in
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
    """Constant time headway, kept by comfortable braking."""

    PINNED: ClassVar[dict[str, str]] = {
        "time_headway": "safety: the gap that is kept on the move",
        "jam_distance": "safety: the gap that is kept at standstill",
        "least_*": "safety: the gap that is always kept",
        "hard_deceleration": "safety: the gap that is always kept",
        "lag": "fact: of control, see 'control.longitudinal.time_constant'",
    }

    time_headway: float = field(default=1.2, metadata=POSITIVE)  # s
    jam_distance: float = 3.0  # m
    deceleration: float = field(default=1.5, metadata=POSITIVE)  # m/s^2, with which one comes to that gap, positive
    easing: float = 1.5  # m/s^2, or what it takes not to come nearer: with which a gap is opened where that is safe
    lag: float = 0.6  # s, in which control follows what is asked for
    least_headway: float = field(default=0.8, metadata=POSITIVE)  # s, control's own lag included
    least_gap: float = 1.0  # m, at standstill
    hard_deceleration: float = field(default=4.0, metadata=POSITIVE)  # m/s^2, positive


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
    """Speed to drive behind a front vehicle [m/s], not above the cap.

    That of Gipps (1981) with equal decelerations, v T_h + v^2 / (2 b) = gap - s0 + v_f^2 / (2 b): behind one of equal
    speed the gap is s0 + v T_h, and one that is slower or stands is approached at no more than b. Where somebody cuts
    in, that gap is opened gently, as long as the same with the least gaps and hard braking is kept. These are v_T and
    v_E of Eq. 28, which the paper leaves open. Without a front vehicle pass a gap of 1e6 m. Args: speed [*B] m/s; gap
    [*B] m, bumper to bumper; front_speed [*B] m/s; cap [*B] m/s.
    """
    front = lean.maximum(front_speed, 0.0)

    def kept(least: float | Array, headway: float | Array, deceleration: float | Array) -> Array:
        room = gap - least + front * front / (2 * deceleration)
        return stop_speed(room, deceleration, reaction_time=headway)

    comfortable = kept(params.jam_distance, params.time_headway, params.deceleration)
    hard = kept(params.least_gap, params.least_headway, params.hard_deceleration)
    closing = lean.maximum(speed - front, 0.0)
    needed = closing * closing / (2 * lean.maximum(gap - params.jam_distance / 2, SHORTEST))
    asked = lean.maximum(AMPLE * needed, params.easing) * params.lag
    gentle = lean.maximum(comfortable, speed - asked)
    cuts_in = lean.clip(front / SLOW, 0.0, 1.0)
    return lean.minimum(lean.minimum(comfortable + cuts_in * (gentle - comfortable), hard), cap)
