"""How a vehicle moves: the kinematic bicycle on the rear axle, and highway-env's on the centre."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import safe
from urbanjax.types import Command, VehicleState
from urbanjax.vehicle.params import VehicleParams


def bicycle_step(
    state: VehicleState, command: Command, *, params: VehicleParams, dt: float | Float[Array, ""]
) -> VehicleState:
    """State after `dt` s of the kinematic bicycle, without slip, about the rear axle.

    The command is limited first: acceleration, steering rate, steering angle, speed in [0, max] (no reversing). The
    position is exact for the curvature held over the step; the distance is the mean of both speeds times dt. The
    returned acceleration and steering are those that took effect. Args: state, of the rear axle; command, acceleration
    and steering for the step; dt [s].
    """
    turned = jnp.clip(command.steering - state.steering, -params.max_steering_rate * dt, params.max_steering_rate * dt)
    steering = jnp.clip(state.steering + turned, -params.max_steering, params.max_steering)
    acceleration = jnp.clip(command.acceleration, -params.max_deceleration, params.max_acceleration)
    speed = jnp.clip(state.speed + acceleration * dt, 0.0, params.max_speed)
    distance = 0.5 * (state.speed + speed) * dt
    turn = distance * jnp.tan(steering) / params.wheelbase
    middle = state.heading + 0.5 * turn
    step = jnp.stack([jnp.cos(middle), jnp.sin(middle)], axis=-1) * (distance * safe.sinc(0.5 * turn))[..., None]
    return VehicleState(
        position=state.position + step,
        heading=state.heading + turn,
        speed=speed,
        acceleration=(speed - state.speed) / dt,
        steering=steering,
    )


def highway_step(
    state: VehicleState, command: Command, *, dt: float, length: float = 5.0, max_speed: float = 40.0
) -> VehicleState:
    """State after one explicit Euler step of highway-env's `Vehicle.step`.

    Its reference point is the centre, not the rear axle, its axles stand half a length before and behind, and speed is
    limited softly through the acceleration only. Impacts after a collision are not modelled. Args: state, whose
    `position` is the centre of the box; command, acceleration and steering for the step; dt [s]; length [m] of the
    vehicle; max_speed [m/s].
    """
    heading, speed, wanted = state.heading, state.speed, command.acceleration
    limited = jnp.where(speed > max_speed, jnp.minimum(wanted, max_speed - speed), wanted)
    limited = jnp.where(speed < -max_speed, jnp.maximum(wanted, -max_speed - speed), limited)
    slip = jnp.arctan(0.5 * jnp.tan(command.steering))  # at the centre, halfway between the axles
    course = jnp.stack([jnp.cos(heading + slip), jnp.sin(heading + slip)], axis=-1)
    return VehicleState(
        position=state.position + speed[..., None] * course * dt,
        heading=heading + speed * jnp.sin(slip) / (length / 2) * dt,
        speed=speed + limited * dt,
        acceleration=limited,
        steering=command.steering,
    )


def box_centre(state: VehicleState, params: VehicleParams) -> Float[Array, "*b 2"]:
    """Centre of the vehicle's box, [.., 2] m. Args: state, of the rear axle."""
    forward = jnp.stack([jnp.cos(state.heading), jnp.sin(state.heading)], axis=-1)
    return state.position + params.centre_offset * forward
