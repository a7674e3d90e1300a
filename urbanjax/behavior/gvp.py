"""Geometry-aware velocity planning: one speed from two car-following speeds (Eq. 28-29)."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.behavior.surroundings import OccupancyParams, Surroundings, in_lane
from urbanjax.numerics import safe, soft
from urbanjax.numerics.soft import Relaxation
from urbanjax.types import pytree, static
from urbanjax.vehicle.following import HeadwayParams, constant_headway_speed
from urbanjax.vehicle.params import VehicleParams


@pytree
class GVPParams:
    """Aggressiveness and the shape of the two lanes that it weighs."""

    tau: float = 0.75  # [-], aggressiveness factor of Eq. 29; 0 follows the geometry now, 1 where the path leads
    clamp_time: float = 1.2  # s, least time to collision with what the chosen path does not clear
    ttc_clamp: bool = static(default=True)  # limit v_ref by clamp_time (not in the paper)


@pytree
class LaneSpeeds:
    """The parts of Eq. 28-29, for reports."""

    target: Array  # [] m/s, v_T
    ego: Array  # [] m/s, v_E
    micro: Array  # [] m/s, v^micro
    cog: Array  # [] m/s, v^cog
    reference: Array  # [] m/s, v^ref


def following_speed(
    surroundings: Surroundings,
    occupancy: Float[Array, "o"],
    front: Float[Array, ""],
    lead: Float[Array, "o"],
    speed: Float[Array, ""],
    cap: Float[Array, ""],
    headway: HeadwayParams,
    relaxation: Relaxation,
) -> Float[Array, ""]:
    """Car-following speed in m/s behind the most restrictive object of a lane (v_T or v_E of Eq. 28).

    Args: occupancy [O], degree of being in the lane; front m, station of the ego's front bumper; lead [O] m, how far
    its rear is ahead of the ego's front when the ego is in the lane (one that is passed before does not count).
    """
    gap = surroundings.station - surroundings.half_length - front
    ahead = soft.above(lead, -0.5, relaxation, scale=1.0)
    speed, cap = (jnp.broadcast_to(x, gap.shape) for x in (speed, cap))
    each = constant_headway_speed(speed, gap, front_speed=surroundings.speed, cap=cap, params=headway)
    relevant = soft.both(occupancy, ahead)
    bounds = jnp.append(cap - relevant * (cap - each), cap[:1])  # the last one holds when there is no object
    valid = jnp.append(surroundings.valid, True)
    return soft.minimum(bounds, relaxation, scale=0.5, fill=1e3, mask=valid)


def blend(to_target: Array, to_ego: Array, v_target: Array, v_ego: Array) -> Array:
    """Speed weighted by the distances to the two lanes (one line of Eq. 28); v_T = v_E where both are zero."""
    weight = safe.divide(to_ego, to_target + to_ego, otherwise=0.5)
    return weight * v_target + (1 - weight) * v_ego


def plan_speed(
    terminal: tuple[Array, Array],
    centre: tuple[Array, Array],
    v_target: Float[Array, ""],
    v_ego: Float[Array, ""],
    params: GVPParams,
) -> LaneSpeeds:
    """The reference speed v_ref = tau v_micro + (1 - tau) v_cog (Eq. 28-29).

    Args: terminal, centre: distances in metres (to the target lane, to the ego lane) of the path's end and of the
    vehicle's centre of gravity.
    """
    micro = blend(*terminal, v_target, v_ego)
    cog = blend(*centre, v_target, v_ego)
    return LaneSpeeds(
        target=v_target, ego=v_ego, micro=micro, cog=cog, reference=params.tau * micro + (1 - params.tau) * cog
    )


def clamp(
    surroundings: Surroundings,
    path_offset: Float[Array, "o"],
    front: Float[Array, ""],
    vehicle: VehicleParams,
    params: GVPParams,
    occupancy: OccupancyParams,
    relaxation: Relaxation,
) -> Float[Array, ""]:
    """Highest speed in m/s that keeps `clamp_time` to what the chosen path does not clear sideways.

    Args: path_offset [O] m, offset of the chosen path where it reaches each object's rear.
    """
    gap = surroundings.station - surroundings.half_length - front
    ahead = soft.above(gap + surroundings.half_length, 0.0, relaxation, scale=1.0)
    degree = soft.both(in_lane(surroundings, path_offset, vehicle.width / 2, occupancy, relaxation), ahead)
    allowed = jnp.maximum(surroundings.speed + jnp.maximum(gap, 0) / params.clamp_time, 0)
    free = jnp.asarray(vehicle.max_speed, allowed.dtype)
    each = free - degree * (free - jnp.minimum(allowed, free))
    return soft.minimum(each, relaxation, scale=0.5, fill=1e3, mask=surroundings.valid)
