"""What is kept of each step of a run: enough for all metrics, scores and figures."""

import jax.numpy as jnp
from jax import Array

from urbanjax.numerics import soft
from urbanjax.numerics.soft import Relaxation
from urbanjax.sim import agents, reaction
from urbanjax.sim import lanes as roads
from urbanjax.sim.lanes import Lanes
from urbanjax.sim.world import HARD, SimParams, WorldState
from urbanjax.types import Command, Objects, VehicleState, pytree
from urbanjax.vehicle.model import box_centre


@pytree
class Log:
    """One step of the world, or T of them stacked along the first axis."""

    time: Array  # [T] s
    ego: VehicleState  # [T], the state in which the command was given
    command: Command  # [T]
    centre: Array  # [T, 2] m, centre of the ego's box
    along: Array  # [T] m/s, the ego's speed along its lane
    offset: Array  # [T] m, from the centre of the lane it is on, left positive
    road_margin: Array  # [T] m, from its outermost corner to the edge of the road, negative outside
    traffic: Objects  # [T, V], all vehicles, seen or not


def record(params: SimParams, lanes: Lanes, world: WorldState, command: Command, relaxation: Relaxation = HARD) -> Log:
    """The world now, and the command given in it.

    The road is the lane the ego is on, its neighbours and those in the opposite direction; corners are measured in the
    straight frame at the box centre.
    """
    ego, vehicle, graph = world.ego, params.vehicle, lanes.graph
    centre = box_centre(ego, vehicle)
    link = reaction.own_link(lanes, world.ego_link, centre, ego.heading)
    links, exists = reaction.around(graph, link)
    place = roads.place(lanes, links, centre)
    error = ego.heading - place.heading
    ahead, aside = 0.5 * vehicle.length * jnp.sin(error), 0.5 * vehicle.width * jnp.cos(error)
    corner = jnp.stack([ahead + aside, ahead - aside, aside - ahead, -ahead - aside], axis=1) + place.offset[:, None]
    outside = jnp.abs(corner) - 0.5 * lanes.width[links][:, None]
    # A link that ends before the ego is no ground beneath it.
    outside = outside + jnp.maximum(place.distance - jnp.abs(place.offset), 0.0)[:, None]
    of_corner = soft.minimum(outside.T, relaxation, 1.0, jnp.broadcast_to(exists[None, :], outside.T.shape))
    return Log(
        time=world.time,
        ego=ego,
        command=command,
        centre=centre,
        along=ego.speed * jnp.cos(error[0]),
        offset=place.offset[0],
        road_margin=soft.minimum(-of_corner, relaxation),
        traffic=agents.objects(lanes, world.traffic, params.traffic),
    )
