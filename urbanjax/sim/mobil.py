"""Lane changes of traffic (MOBIL, Kesting, Treiber, Helbing 2007), decided once per policy step.

Left and right take turns from step to step: two vehicles never enter one lane from both sides at once, and half of
the pairs need no look. A vehicle in a change looks at the lane that it is leaving instead, since it still has to keep
its distance there.
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int

from urbanjax.sim import lanes as roads
from urbanjax.sim.agents import Traffic, TrafficParams
from urbanjax.sim.lanes import LaneTables, take
from urbanjax.sim.neighbours import FAR, Bodies, Chain, Neighbour, ahead, behind, look_ahead, nearest
from urbanjax.sim.priority import end_distance
from urbanjax.types import pytree
from urbanjax.vehicle.following import IDMParams, interaction


@pytree
class Drivers:
    """What MOBIL needs to know of N drivers, the ego included."""

    bodies: Bodies
    chain: Chain
    route: Array  # [N] int32
    exists: Array  # [N] bool
    free: Array  # [N] m/s^2, acceleration on a free road
    headway: Array  # [N] s


@pytree
class Beside:
    """A place in the lane beside each vehicle."""

    link: Array  # [N] int32
    station: Array  # [N] m
    distance: Array  # [N] m to that lane's centre from the vehicle's own, left positive
    permitted: Array  # [N] bool, there is such a lane and a change to it is allowed


def incentive(
    own_gain: Float[Array, "*n"],
    new_follower_gain: Float[Array, "*n"],
    *,
    old_follower_gain: Float[Array, "*n"],
    politeness: Float[Array, "*n"],
) -> Float[Array, "*n"]:
    """MOBIL's balance of accelerations [m/s^2], own gain + politeness (new follower's gain + old follower's).

    Args: own_gain, new_follower_gain and old_follower_gain [*N] m/s^2; politeness [*N].
    """
    return own_gain + politeness * (new_follower_gain + old_follower_gain)


def beside(lanes: LaneTables, link: Int[Array, " n"], *, station: Float[Array, " n"], left: Bool[Array, ""]) -> Beside:
    """The place beside each vehicle, on the left or on the right.

    Args: lanes, the simulator's tables; link [N]; station [N] m along it; left [] bool, which side.
    """
    graph, row = lanes.graph, roads.at(lanes, link, station=station)
    to_left, to_right = graph.has_left & graph.left_change, graph.has_right & graph.right_change
    return Beside(
        take(jnp.where(left, graph.left_link, graph.right_link), link),
        jnp.where(left, row[:, roads.LEFT_STATION], row[:, roads.RIGHT_STATION]),
        jnp.where(left, row[:, roads.LEFT_DISTANCE], row[:, roads.RIGHT_DISTANCE]),
        take(jnp.where(left, to_left, to_right), link),
    )


def decide(
    lanes: LaneTables, traffic: Traffic, *, drivers: Drivers, left: Bool[Array, ""], params: TrafficParams
) -> tuple[Traffic, Float[Array, " v"]]:
    """Traffic with the changes that begin now, and braking [m/s^2] towards leaders in lanes being left.

    Args: lanes, the simulator's tables; traffic, V vehicles; drivers, the V vehicles first, then the ego; left [] bool,
    which side has its turn.
    """
    v, bodies, exists = traffic.link.shape[0], drivers.bodies, drivers.exists
    changing = (traffic.moved < 1) & traffic.has_other
    side = beside(lanes, traffic.link, station=traffic.station, left=left)
    link = jnp.where(changing, traffic.other, side.link)
    station = jnp.where(changing, traffic.other_station, side.station)
    side_chain = look_ahead(
        lanes, link, station=station, choice=traffic.route, exists=traffic.valid, n_links=params.n_links
    )
    seen = exists[:, None] & ~jnp.eye(exists.shape[0], v, dtype=bool)
    half = bodies.half[:v]
    new_leader = nearest(ahead(side_chain, bodies, seen=seen), bodies, half=half)
    new_follower = nearest(behind(drivers.chain, link, station=station, seen=seen), bodies, half=half)
    idm = params.idm.replace(time_headway=traffic.headway)
    braking = interaction(traffic.speed, new_leader.gap, front_speed=new_leader.speed, params=idm)
    braking = jnp.maximum(braking, _end_braking(lanes, traffic, side_chain, half, idm))
    wants = _wants(lanes, traffic, drivers, new_leader, new_follower, braking, seen, params)
    leaving = jnp.abs(bodies.other_station[:, None] - station[None, :]) - bodies.half[:, None] - half[None, :]
    blocks = seen & (bodies.other[:, None] == link[None, :]) & (leaving < params.min_gap)
    wants = wants & ~jnp.any(blocks, axis=0)
    room = traffic.station + traffic.speed * params.change_duration < take(lanes.graph.length, traffic.link)
    room = room | take(lanes.ends, traffic.link)
    starts = wants & room & side.permitted & ~changing & (traffic.moved >= 1)
    return _begin(traffic, side, starts, params), jnp.where(changing, braking, 0.0)


def _end_braking(lanes: LaneTables, traffic: Traffic, chain: Chain, half: Array, idm: IDMParams) -> Array:
    return interaction(
        traffic.speed, end_distance(lanes, chain, front=half), front_speed=jnp.zeros_like(half), params=idm
    )


def _wants(
    lanes: LaneTables,
    traffic: Traffic,
    drivers: Drivers,
    new_leader: Neighbour,
    new_follower: Neighbour,
    new_braking: Array,
    seen: Array,
    params: TrafficParams,
) -> Bool[Array, " v"]:
    """Which vehicles gain enough by the change, and endanger nobody."""
    v, bodies, chain = traffic.link.shape[0], drivers.bodies, drivers.chain
    half, idm = bodies.half[:v], params.idm.replace(time_headway=traffic.headway)
    every_idm = params.idm.replace(time_headway=drivers.headway)
    everyone = drivers.exists[:, None] & ~jnp.eye(drivers.exists.shape[0], dtype=bool)
    front = nearest(ahead(chain, bodies, seen=everyone), bodies, half=bodies.half)
    now = interaction(bodies.speed, front.gap, front_speed=front.speed, params=every_idm)
    own_chain = Chain(chain.link[:, :v], chain.start[:, :v])
    own_now = jnp.maximum(now[:v], _end_braking(lanes, traffic, own_chain, half, idm))
    old_follower = nearest(behind(chain, traffic.link, station=traffic.station, seen=seen), bodies, half=half)

    def imposed(who: Neighbour, gap: Array, speed: Array) -> Array:
        """Braking of each vehicle's follower at `gap` behind something at `speed`."""
        followers = params.idm.replace(time_headway=take(drivers.headway, who.index))
        return jnp.where(
            who.exists, interaction(take(bodies.speed, who.index), gap, front_speed=speed, params=followers), 0.0
        )

    new_imposed = imposed(new_follower, new_follower.gap, traffic.speed)
    new_before = jnp.where(new_follower.exists, take(now, new_follower.index), 0.0)
    old_before = imposed(old_follower, old_follower.gap, traffic.speed)
    opened = jnp.where(front.exists[:v], old_follower.gap + 2 * half + front.gap[:v], FAR)
    old_after = imposed(old_follower, opened, front.speed[:v])
    gain = incentive(
        own_now - new_braking,
        new_before - new_imposed,
        old_follower_gain=old_before - old_after,
        politeness=traffic.politeness,
    )
    follower_free = jnp.where(new_follower.exists, take(drivers.free, new_follower.index), 0.0)
    safe = (follower_free - new_imposed > -params.safe_deceleration) & (
        drivers.free[:v] - new_braking > -params.safe_deceleration
    )
    roomy = (new_leader.gap > params.min_gap) & (new_follower.gap > params.min_gap)
    ready = traffic.valid & traffic.changes & (traffic.cooldown <= 0) & (traffic.speed > params.min_speed)
    return (gain > params.gain_threshold) & safe & roomy & ready


def _begin(traffic: Traffic, side: Beside, starts: Array, params: TrafficParams) -> Traffic:
    """Put the starting vehicles on their new link, at the lateral offset that leaves them where they are."""
    offset = jnp.where(starts, traffic.offset - side.distance, traffic.offset)
    return traffic.replace(
        link=jnp.where(starts, side.link, traffic.link),
        station=jnp.where(starts, side.station, traffic.station),
        offset=offset,
        offset_from=jnp.where(starts, offset, traffic.offset_from),
        offset_to=jnp.where(starts, 0.0, traffic.offset_to),
        moved=jnp.where(starts, 0.0, traffic.moved),
        cooldown=jnp.where(starts, params.change_duration + params.change_pause, traffic.cooldown),
        other=jnp.where(starts, traffic.link, traffic.other),
        other_station=jnp.where(starts, traffic.station, traffic.other_station),
        has_other=starts | traffic.has_other,
    )
