"""Geometry-aware velocity planning: one speed from two car-following speeds (Eq. 28-29)."""

from typing import ClassVar

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.behavior.situation import Body
from urbanjax.behavior.surroundings import Surroundings
from urbanjax.numerics import lean, safe, soft
from urbanjax.types import POSITIVE, SHARE, field, pytree, static
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.following import constant_headway_speed
from urbanjax.vehicle.limits import approach_speed


@pytree
class GVPParams:
    """Aggressiveness and the shape of the two lanes that it weighs."""

    PINNED: ClassVar[dict[str, str]] = {
        "overlap": "safety: of whom the ego need not keep clear",
        "clamp_time": "safety: the least time to collision",
        "pass_*": "safety: how fast somebody is passed closely",
    }

    # [-], aggressiveness factor of Eq. 29; 0 follows the geometry now, 1 where the path leads
    tau: float = field(default=0.75, metadata=SHARE)
    overlap: float = 0.5  # m, by which bumpers may overlap and the other one still leads
    # s, least time to collision with what the chosen path does not clear
    clamp_time: float = field(default=1.2, metadata=POSITIVE)
    pass_speed: float = 2.5  # m/s, with which one who stands is passed without any room beside
    pass_gain: float = 10.0  # 1/s, by which it is more with each metre of room
    pass_deceleration: float = field(default=1.5, metadata=POSITIVE)  # m/s^2, towards that
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
    driving: Driving,
    *,
    occupancy: Float[Array, "o"],
    body: Body,
    lead: Float[Array, "o"],
    cap: Float[Array, ""],
) -> Float[Array, ""]:
    """Car-following speed in m/s behind the most restrictive object of a lane (v_T or v_E of Eq. 28).

    Args: surroundings [O]; driving, with BehaviorParams; occupancy [O], degree of being in the lane; body, of the ego;
    lead [O] m, how far its rear is ahead of the ego's front when the ego is in the lane (one that is passed before does
    not count, nor does one whose front is still behind the ego's); cap [] m/s, without anybody.
    """
    params, relaxation = driving.params, driving.relaxation
    gap = surroundings.station - surroundings.half_length - body.front
    ahead = soft.above(lead, -params.gvp.overlap, relaxation, scale=1.0)
    speed, cap = (jnp.broadcast_to(x, gap.shape) for x in (body.speed, cap))
    each = constant_headway_speed(speed, gap, front_speed=surroundings.speed, cap=cap, params=params.headway)
    in_front = soft.above(gap + 2 * surroundings.half_length, 0.0, relaxation, scale=1.0)
    relevant = soft.both(occupancy, soft.both(ahead, in_front))
    bounds = jnp.append(cap - relevant * (cap - each), cap[:1])  # the last one holds when there is no object
    valid = jnp.append(surroundings.valid, True)
    return soft.minimum(bounds, relaxation, scale=0.5, fill=1e3, mask=valid)


def blend(to_target: Array, to_ego: Array, *, v_target: Array, v_ego: Array) -> Array:
    """Speed weighted by the distances to the two lanes (one line of Eq. 28); v_T = v_E where both are zero.

    Args: to_target, to_ego [] m, distances to the lanes; v_target, v_ego [] m/s, v_T and v_E.
    """
    weight = safe.divide(to_ego, to_target + to_ego, otherwise=0.5)
    return weight * v_target + (1 - weight) * v_ego


def plan_speed(
    terminal: tuple[Array, Array],
    centre: tuple[Array, Array],
    *,
    v_target: Float[Array, ""],
    v_ego: Float[Array, ""],
    params: GVPParams,
) -> LaneSpeeds:
    """The reference speed v_ref = tau v_micro + (1 - tau) v_cog (Eq. 28-29).

    Args: terminal, centre: distances in metres (to the target lane, to the ego lane) of the path's end and of the
    vehicle's centre of gravity; v_target, v_ego [] m/s, v_T and v_E.
    """
    micro = blend(*terminal, v_target=v_target, v_ego=v_ego)
    cog = blend(*centre, v_target=v_target, v_ego=v_ego)
    return LaneSpeeds(
        target=v_target, ego=v_ego, micro=micro, cog=cog, reference=params.tau * micro + (1 - params.tau) * cog
    )


def clamp(
    surroundings: Surroundings, driving: Driving, *, in_path: Float[Array, "o"], front: Float[Array, ""]
) -> Float[Array, ""]:
    """Highest speed in m/s that keeps `clamp_time` to what the chosen path does not clear sideways.

    Args: surroundings [O]; driving, with BehaviorParams; in_path [O], degree to which each is in the chosen path's way;
    front [] m, station of the ego's front bumper.
    """
    params, relaxation = driving.params, driving.relaxation
    gap = surroundings.station - surroundings.half_length - front
    ahead = soft.above(gap + surroundings.half_length, 0.0, relaxation, scale=1.0)
    degree = soft.both(in_path, ahead)
    allowed = lean.maximum(surroundings.speed + lean.maximum(gap, 0) / params.gvp.clamp_time, 0)
    free = jnp.asarray(driving.vehicle.max_speed, allowed.dtype)
    each = free - degree * (free - lean.minimum(allowed, free))
    return soft.minimum(each, relaxation, scale=0.5, fill=1e3, mask=surroundings.valid)


def passing_speed(
    surroundings: Surroundings,
    driving: Driving,
    *,
    offset: Float[Array, "o"],
    moves: Float[Array, "o"],
    body: Body,
    cap: Float[Array, ""],
) -> Float[Array, ""]:
    """Highest speed in m/s from which everybody who stands close to the path is passed slowly, see `pass_speed`.

    Args: surroundings [O]; driving, with BehaviorParams; offset [O] m, of the path beside each; moves [O], degree to
    which each moves; body, of the ego; cap [] m/s, without anybody.
    """
    params, relaxation = driving.params.gvp, driving.relaxation
    away = safe.sqrt((surroundings.offset - offset) ** 2 + 1e-6)
    room = away - surroundings.half_width - driving.vehicle.width / 2
    beside = params.pass_speed + params.pass_gain * lean.maximum(room, 0.0)
    gap = surroundings.station - surroundings.half_length - body.front
    allowed = lean.minimum(approach_speed(gap, beside, deceleration=params.pass_deceleration), cap)
    passed = body.rear - (surroundings.station + surroundings.half_length)
    counts = soft.both(soft.negate(moves), soft.above(-passed, 0.0, relaxation, scale=1.0))
    each = cap - counts * (cap - allowed)
    return soft.minimum(
        jnp.append(each, cap), relaxation, scale=0.5, fill=1e3, mask=jnp.append(surroundings.valid, True)
    )
