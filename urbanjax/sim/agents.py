"""Traffic on the road graph: state, where it is seen, and one substep of its motion (IDM).

All V vehicles at once, padded. A lane change switches the link at its start and lets the lateral offset decay along
a quintic, while `other` keeps the vehicle visible in the lane that it leaves.
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import lean, polynomial, safe
from urbanjax.sim import lanes as roads
from urbanjax.sim.lanes import LaneTables, take
from urbanjax.sim.neighbours import FAR, Bodies, Chain, ahead, look_ahead, nearest
from urbanjax.sim.scripts import Script
from urbanjax.types import Objects, pytree, static
from urbanjax.vehicle.following import IDMParams, free_acceleration, interaction
from urbanjax.vehicle.limits import approach_speed, curve_speed


@pytree
class TrafficParams:
    """How traffic drives; time headway, politeness, size and desired speed are each driver's own (`Traffic`)."""

    idm: IDMParams = IDMParams()
    politeness: float = 0.3  # MOBIL's weight of others' losses, of the default driver
    vehicle_length: float = 4.5  # m, of the default vehicle
    vehicle_width: float = 1.9  # m
    max_deceleration: float = 6.0  # m/s^2, positive
    lateral_acceleration: float = 2.5  # m/s^2, in curves
    gain_threshold: float = 0.2  # m/s^2, MOBIL: what a change must be worth
    safe_deceleration: float = 2.0  # m/s^2, MOBIL: braking imposed on the new follower, and on oneself
    min_gap: float = 2.0  # m, free ahead and behind in the new lane
    min_speed: float = 1.0  # m/s, below which no change begins
    change_duration: float = 3.0  # s
    change_pause: float = 3.0  # s, between the end of one change and the next
    tail: float = 2.0  # m, a vehicle is seen on the link behind until its rear is this far past the end
    patience: float = 4.0  # s, the gap in time that a driver without priority asks for
    conflict_range: float = 40.0  # m before a junction, within which others are watched
    n_links: int = static(default=4)  # links that a driver sees ahead
    reacts_to_oncoming: bool = static(default=True)  # brake for an ego that comes against the lane


@pytree
class Traffic:
    """V vehicles; the reference point is the box centre."""

    link: Array  # [V] int32
    station: Array  # [V] m along the link
    offset: Array  # [V] m from the lane centre, left positive
    speed: Array  # [V] m/s, along the link
    acceleration: Array  # [V] m/s^2
    offset_from: Array  # [V] m, where the lateral move began
    offset_to: Array  # [V] m, where it ends
    moved: Array  # [V] share of the lateral move that is done; 1: no move under way
    cooldown: Array  # [V] s until the next change may begin
    other: Array  # [V] int32, second link that the body covers
    other_station: Array  # [V] m, the same vehicle seen from there
    has_other: Array  # [V] bool
    length: Array  # [V] m
    width: Array  # [V] m
    desired_speed: Array  # [V] wanted speed as a factor of the limit
    headway: Array  # [V] s
    politeness: Array  # [V] MOBIL's weight of others' losses
    route: Array  # [V] int32, takes successor number (route mod count) at each fork
    changes: Array  # [V] bool, may change lanes
    reacts: Array  # [V] bool, follows, stops and yields; False: drives at its wanted speed whatever comes
    valid: Array  # [V] bool


def chain_of(lanes: LaneTables, traffic: Traffic, *, params: TrafficParams) -> Chain:
    """The links that each vehicle is going to drive. Args: lanes, the simulator's tables; traffic, V vehicles."""
    return look_ahead(
        lanes, traffic.link, station=traffic.station, choice=traffic.route, exists=traffic.valid, n_links=params.n_links
    )


def bodies_of(traffic: Traffic) -> Bodies:
    """Where traffic stands. Args: traffic, V vehicles."""
    return Bodies(
        traffic.link,
        jnp.where(traffic.valid, traffic.station, -FAR),
        traffic.other,
        jnp.where(traffic.valid & traffic.has_other, traffic.other_station, -FAR),
        0.5 * traffic.length,
        traffic.speed,
    )


def wanted_speed(
    lanes: LaneTables, factor: Float[Array, " v"], *, chain: Chain, params: TrafficParams
) -> Float[Array, " v"]:
    """Speed to aim for [m/s]: each driver's `factor` of the limit, capped in curves here and ahead.

    Args: lanes, the simulator's tables; factor [V], of the limit; chain, the links ahead of each driver.
    """
    limit = take(lanes.graph.speed_limit, chain.link) * factor[None, :]
    allowed = curve_speed(take(lanes.curvature, chain.link), params.lateral_acceleration, cap=limit)
    distance = jnp.where(chain.start > -0.5 * FAR, lean.maximum(chain.start, 0.0), FAR)
    return safe.minimum(approach_speed(distance, allowed, deceleration=params.idm.deceleration), 0)


def follow(
    lanes: LaneTables, traffic: Traffic, *, chain: Chain, braking: Float[Array, " v"], params: TrafficParams
) -> Float[Array, " v"]:
    """Acceleration [m/s^2]: free road less the strongest of `braking` and what the vehicle ahead asks for.

    Args: lanes, the simulator's tables; traffic, V vehicles; chain, the links ahead of each driver; braking [V] m/s^2,
    positive.
    """
    bodies = bodies_of(traffic)
    front = nearest(ahead(chain, bodies, seen=~jnp.eye(traffic.link.shape[0], dtype=bool)), bodies, half=bodies.half)
    idm = params.idm.replace(time_headway=traffic.headway)
    free = free_acceleration(
        traffic.speed, wanted_speed(lanes, traffic.desired_speed, chain=chain, params=params), params=idm
    )
    strongest = lean.maximum(braking, interaction(traffic.speed, front.gap, front_speed=front.speed, params=idm))
    wanted = free - jnp.where(traffic.reacts, strongest, 0.0)
    return jnp.clip(wanted, -params.max_deceleration, params.idm.acceleration)


def stop_braking(traffic: Traffic, distance: Float[Array, " v"], *, params: TrafficParams) -> Float[Array, " v"]:
    """Braking [m/s^2] towards a standstill `distance` m before the front bumper.

    Args: traffic, V vehicles; distance [V] m.
    """
    return interaction(traffic.speed, distance, front_speed=jnp.zeros_like(distance), params=params.idm)


def move(
    lanes: LaneTables,
    traffic: Traffic,
    *,
    acceleration: Float[Array, " v"],
    params: TrafficParams,
    dt: float | Array,
    pace: Float[Array, " v"] | None = None,
) -> Traffic:
    """Traffic after `dt` s: along the links, from link to link, and across in a lane change.

    A vehicle that leaves a link without successor is gone (`valid` False). Args: lanes, the simulator's tables;
    traffic, V vehicles; acceleration [V] m/s^2; dt [s]; pace [V] 1/s, of lateral moves (None: of lane changes).
    """
    speed = lean.maximum(traffic.speed + acceleration * dt, 0.0)
    travelled = 0.5 * (traffic.speed + speed) * dt
    # The lateral move goes with the distance below a walking pace, so that nobody slides sideways at a halt.
    slow = lean.minimum(speed / params.min_speed, 1.0)
    pace = slow / params.change_duration if pace is None else slow * pace
    moved = lean.minimum(traffic.moved + pace * dt, 1.0)
    share = polynomial.smoother_step(moved)
    moving = moved < 1
    traffic = traffic.replace(
        speed=speed,
        acceleration=jnp.where(dt > 0, (speed - traffic.speed) / dt, 0.0),
        station=traffic.station + travelled,
        other_station=traffic.other_station + travelled,
        moved=moved,
        offset=traffic.offset_from * (1 - share) + traffic.offset_to * share,
        cooldown=lean.maximum(traffic.cooldown - dt, 0.0),
    )
    return _cross(lanes, traffic, moving, params)


def _cross(lanes: LaneTables, traffic: Traffic, moving: Array, params: TrafficParams) -> Traffic:
    """Hand vehicles that passed the end of their link (or of their other link) to the next one."""
    length = take(lanes.graph.length, traffic.link)
    other_length = take(lanes.graph.length, traffic.other)
    follows, goes_on = roads.following(lanes, traffic.link, choice=traffic.route)
    other_follows, other_goes_on = roads.following(lanes, traffic.other, choice=traffic.route)
    past, other_past = traffic.station > length, traffic.other_station > other_length
    crosses, stays = past & goes_on, past & ~goes_on & take(lanes.ends, traffic.link)
    # In a lane change the other link is the lane being left, which goes on; otherwise it is the link behind.
    shadows = moving & other_past & other_goes_on
    trails = traffic.other_station - 0.5 * traffic.length < other_length + params.tail
    left_behind = crosses & ~(moving & traffic.has_other)
    other = jnp.where(shadows, other_follows, traffic.other)
    other_station = traffic.other_station - jnp.where(shadows, other_length, 0.0)
    return traffic.replace(
        link=jnp.where(crosses, follows, traffic.link),
        station=jnp.where(stays, length, traffic.station - jnp.where(crosses, length, 0.0)),
        other=jnp.where(left_behind, traffic.link, other),
        other_station=jnp.where(left_behind, traffic.station, other_station),
        has_other=left_behind | (traffic.has_other & jnp.where(moving, ~other_past | shadows, other_past & trails)),
        valid=traffic.valid & ~(past & ~goes_on & ~stays),
    )


def objects(lanes: LaneTables, traffic: Traffic, *, params: TrafficParams, script: Script | None = None) -> Objects:
    """The vehicles as boxes in the world, [V].

    Args: lanes, the simulator's tables; traffic, V vehicles; script, of those that move over in a time of their own.
    """
    row = roads.at(lanes, traffic.link, station=traffic.station)
    heading = row[:, roads.HEADING]
    share = traffic.moved
    # 30 s^2 (1 - s)^2 is the derivative of the quintic.
    duration = params.change_duration
    duration = duration if script is None else jnp.where(script.scripted, script.moves_for, duration)
    slope = 30 * (share * (1 - share)) ** 2 / duration
    turned = (traffic.offset_to - traffic.offset_from) * slope / lean.maximum(traffic.speed, params.min_speed)
    normal = jnp.stack([-jnp.sin(heading), jnp.cos(heading)], axis=-1)
    return Objects(
        position=row[:, : roads.HEADING] + traffic.offset[:, None] * normal,
        heading=heading + jnp.arctan(turned),
        speed=traffic.speed,
        length=traffic.length,
        width=traffic.width,
        valid=traffic.valid,
    )
