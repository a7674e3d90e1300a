"""What is kept of each step of a run: enough for all metrics, scores and figures."""

import jax.numpy as jnp
from jax import Array

from urbanjax.geometry.polyline import Projection
from urbanjax.numerics import soft
from urbanjax.numerics.soft import Relaxation
from urbanjax.sim import lanes as roads
from urbanjax.sim import reaction
from urbanjax.sim.lanes import LaneTables
from urbanjax.sim.world import HARD, SimParams, Snapshot, WorldState, look
from urbanjax.types import Command, Objects, VehicleState, pytree

EDGE = 0.2  # m, natural scale of the choice of edge and corner for the relaxation


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


def record(
    params: SimParams,
    lanes: LaneTables,
    *,
    world: WorldState,
    command: Command,
    relaxation: Relaxation = HARD,
    seen: Snapshot | None = None,
) -> Log:
    """The world now, and the command given in it.

    Args: lanes, of the road; world, now; command, of the ego; relaxation, of `road_margin`; seen, the look at the world
    where it was already taken.
    """
    ego, vehicle = world.ego, params.vehicle
    seen = look(params, lanes, world=world) if seen is None else seen
    links, exists = reaction.around(lanes.graph, seen.ego_link)
    place = roads.place(lanes, links, position=seen.centre)
    error = ego.heading - place.heading
    left, right = _edges(place, error, 0.5 * lanes.width[links], exists, relaxation)
    aside, ahead = 0.5 * vehicle.width * jnp.cos(error[0]), 0.5 * vehicle.length * jnp.sin(error[0])
    corner = jnp.stack([ahead + aside, ahead - aside, aside - ahead, -ahead - aside])
    return Log(
        time=world.time,
        ego=ego,
        command=command,
        centre=seen.centre,
        along=ego.speed * jnp.cos(error[0]),
        offset=place.offset[0],
        road_margin=soft.minimum(jnp.concatenate([left - corner, corner - right]), relaxation, scale=EDGE),
        traffic=seen.others,
    )


def _edges(
    place: Projection, error: Array, half_width: Array, exists: Array, relaxation: Relaxation
) -> tuple[Array, Array]:
    """Lateral positions of the road's left and right edge [m], seen from the ego along its own lane.

    The road is the lane the ego is on with its neighbours and those in the opposite direction, taken to be contiguous.
    """
    centre = -place.offset * jnp.sign(jnp.cos(error))
    # A lane that ends before the ego, or begins after it, is no ground beside it.
    beside = half_width - jnp.maximum(place.distance - jnp.abs(place.offset), 0.0)
    left = -soft.minimum(-(centre + beside), relaxation, scale=EDGE, mask=exists)
    return left, soft.minimum(centre - beside, relaxation, scale=EDGE, mask=exists)
