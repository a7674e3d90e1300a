"""The ego as traffic sees it: where it stands on the links around it, and the braking that it causes.

Positions on links are exact projections, so braking is continuous in the ego's state; in mode soft of the relaxation
it is smooth but for the maximum over links and the nearest point of each polyline.
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int

from urbanjax.numerics import safe, soft
from urbanjax.numerics.soft import Relaxation
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.sim import lanes as roads
from urbanjax.sim.agents import Traffic, TrafficParams
from urbanjax.sim.lanes import LaneTables
from urbanjax.sim.neighbours import FAR, Chain
from urbanjax.types import VehicleState, pytree
from urbanjax.vehicle.following import interaction
from urbanjax.vehicle.model import box_centre
from urbanjax.vehicle.params import VehicleParams

REACH = 10.0  # m behind a driver up to which the ego is still looked for, so that passing it is smooth
BASE, LEFT, RIGHT = range(3)  # places in `Presence`; the others are links in the opposite direction


@pytree
class ReactionParams:
    """When traffic takes the ego to be in a lane."""

    margin: float = 0.3  # m, how far it has to reach into the lane
    anticipation: float = 1.0  # s, for which its lateral speed is extrapolated
    lateral_scale: float = 1.0  # m, natural scale of "in the lane" for the relaxation
    passing_scale: float = 5.0  # m, natural scale of "ahead" for the relaxation


@pytree
class Presence:
    """The ego on E links: its own, the left and right neighbours, and those in the other direction."""

    link: Array  # [E] int32
    exists: Array  # [E] bool
    station: Array  # [E] m, of the box centre
    reach: Array  # [E] m into the lane, negative outside it
    speed: Array  # [E] m/s along the link, negative against it
    length: Array  # [] m


def around(graph: RoadGraph, link: Int[Array, ""]) -> tuple[Int[Array, " e"], Bool[Array, " e"]]:
    """The link itself, its left and right neighbours and those in the opposite direction, and which of them exist.

    Args: graph, the road graph; link, the one the ego is on.
    """
    links = jnp.concatenate([jnp.stack([link, graph.left_link[link], graph.right_link[link]]), graph.opposite[link]])
    beside = jnp.stack([jnp.array(True), graph.has_left[link], graph.has_right[link]])
    return links, jnp.concatenate([beside, graph.has_opposite[link]])


def presence(
    lanes: LaneTables, link: Int[Array, ""], *, ego: VehicleState, vehicle: VehicleParams, params: ReactionParams
) -> Presence:
    """Where the ego stands on `link`, the one it is on, and on the links beside it.

    Args: lanes, the simulator's tables; link, the ego's own; ego, its state; vehicle, its dimensions.
    """
    links, exists = around(lanes.graph, link)
    place = roads.place(lanes, links, position=box_centre(ego, vehicle))
    along = ego.speed * jnp.cos(ego.heading - place.heading)
    across = ego.speed * jnp.sin(ego.heading - place.heading)
    to_come = jnp.abs(place.offset + params.anticipation * across)
    # The distance exceeds the offset beyond the ends of a link, where the ego is not beside it.
    distance = place.distance + jnp.minimum(to_come - jnp.abs(place.offset), 0.0)
    half_widths = 0.5 * (lanes.width[links] + vehicle.width)
    length = jnp.asarray(vehicle.length, ego.speed.dtype)
    return Presence(links, exists, place.station, half_widths - params.margin - distance, along, length)


def braking(
    seen: Presence,
    traffic: Traffic,
    *,
    chain: Chain,
    params: TrafficParams,
    reaction: ReactionParams,
    relaxation: Relaxation,
) -> Float[Array, " v"]:
    """Braking towards the ego [m/s^2], per vehicle: IDM's, weighted by the degree to which the ego is in its way.

    Args: seen, the ego on the links around it; traffic, V vehicles; chain, the links ahead of them; reaction, when they
    take it to be in a lane; relaxation, of that.
    """
    ahead = jnp.full((seen.link.shape[0], traffic.link.shape[0]), FAR, traffic.station.dtype)
    for m in range(chain.link.shape[0]):
        distance = seen.station[:, None] + chain.start[m][None, :]
        on_chain = (seen.link[:, None] == chain.link[m][None, :]) & (distance > -REACH)
        ahead = jnp.where(on_chain, jnp.minimum(ahead, distance), ahead)
    counts = seen.exists if params.reacts_to_oncoming else seen.exists & (seen.speed >= 0)
    inside = jnp.where(counts, soft.above(seen.reach, 0.0, relaxation, scale=reaction.lateral_scale), 0)
    passed = soft.above(ahead, 0.0, relaxation, scale=reaction.passing_scale)
    gap = ahead - 0.5 * (seen.length + traffic.length)[None, :]
    shape = gap.shape
    idm = params.idm.replace(time_headway=jnp.broadcast_to(traffic.headway[None, :], shape))
    ego_speed = jnp.broadcast_to(seen.speed[:, None], shape)
    wanted = interaction(jnp.broadcast_to(traffic.speed[None, :], shape), gap, front_speed=ego_speed, params=idm)
    # Bounded before it is weighted: a huge product of a tiny degree and a huge braking would not be smooth.
    bounded = jnp.minimum(wanted, params.idm.acceleration + params.max_deceleration)
    return safe.maximum(inside[:, None] * passed * bounded, 0)


def advance(seen: Presence, dt: float | Array) -> Presence:
    """The presence `dt` s later, along the links. Args: seen, the ego on the links around it; dt [s]."""
    return seen.replace(station=seen.station + seen.speed * dt)
