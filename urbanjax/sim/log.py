"""What is kept of each step of a run: enough for all metrics, scores and figures."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from urbanjax.numerics import safe, soft
from urbanjax.numerics.soft import Relaxation
from urbanjax.roadmap.edges import edge_distance, edge_rows
from urbanjax.sim import lanes as roads
from urbanjax.sim.lanes import LaneTables
from urbanjax.sim.world import HARD, SimParams, Snapshot, WorldState, look
from urbanjax.types import Command, Objects, ScenarioError, VehicleState, pytree
from urbanjax.types.arguments import kind, traced
from urbanjax.vehicle.params import VehicleParams

EDGE = 0.2  # m, natural scale of the choice of the outermost point for the relaxation
ALONG, ACROSS = 21, 17  # points along each side of the ego's box, and along its front and rear
OUTLINE = np.array(
    [(x, y) for x in np.linspace(-1, 1, ALONG) for y in (-1, 1)]
    + [(x, y) for x in (-1, 1) for y in np.linspace(-1, 1, ACROSS)[1:-1]]
)  # of a box of half sides 1


@pytree
class Log:
    """One step of the world, or T of them stacked along the first axis."""

    time: Array  # [T] s
    ego: VehicleState  # [T], the state in which the command was given
    command: Command  # [T]
    centre: Array  # [T, 2] m, centre of the ego's box
    along: Array  # [T] m/s, the ego's speed along its lane
    offset: Array  # [T] m, from the centre of the lane it is on, left positive
    road_margin: Array  # [T] m, from the outermost point of its box to the edge of the road, negative outside
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
    place = jax.tree.map(lambda x: x[0], roads.place(lanes, seen.ego_link[None], position=seen.centre))
    error = ego.heading - place.heading
    rows = edge_rows(lanes.edge, seen.ego_link, share=place.station / lanes.graph.length[seen.ego_link])
    margins = edge_distance(rows, _outline(ego.heading, seen.centre, vehicle, rows))
    return Log(
        time=world.time,
        ego=ego,
        command=command,
        centre=seen.centre,
        along=ego.speed * jnp.cos(error),
        offset=place.offset,
        road_margin=soft.minimum(margins, relaxation, scale=EDGE),
        traffic=seen.others,
    )


def _outline(heading: Array, centre: Array, vehicle: VehicleParams, rows: Array) -> Array:
    """Points [M, 2] m of the ego's outline: all around, and the one nearest to where an edge of the road begins."""
    ahead = jnp.stack([jnp.cos(heading), jnp.sin(heading)])
    frame = jnp.stack([ahead, jnp.stack([-ahead[1], ahead[0]])])  # world to ego
    half = 0.5 * jnp.stack([jnp.asarray(x, heading.dtype) for x in (vehicle.length, vehicle.width)])
    sides = jnp.asarray(OUTLINE, heading.dtype) * half[None, :]
    corner = jnp.sum((rows[:, None, :2] - centre[None, None, :]) * frame[None, :, :], axis=2)
    beyond = jnp.abs(corner) - half[None, :]
    gap = safe.norm(jnp.maximum(beyond, 0.0)) + jnp.minimum(jnp.max(beyond, axis=1), 0.0)
    k = jnp.argmin(gap)
    inside, depth = jnp.clip(corner[k], -half, half), beyond[k]
    face = (depth == jnp.max(depth)) & (jnp.max(depth) < 0)  # one in the box is nearest to its outline across this face
    nearest = jnp.where(face, jnp.where(inside < 0, -half, half), inside)
    points = jnp.concatenate([sides, nearest[None]])
    return centre[None, :] + jnp.sum(points[:, :, None] * frame[None, :, :], axis=1)


def check(log: Log) -> None:
    """Raise ScenarioError for what is not the log of one run of two steps or more.

    Shapes always; values outside jit, vmap and grad only. Args: log, as given.
    """
    kind(log, "log", wanted=Log, error=ScenarioError)
    kind(log.traffic, "log.traffic", wanted=Objects, error=ScenarioError)
    shape = np.shape(log.time)
    if len(shape) != 1 or shape[0] < 2:
        raise ScenarioError(
            f"log.time has the shape {shape}: one run [T] of two steps or more is needed; of a batch take "
            "jax.tree.map(lambda x: x[k], log), or vmap"
        )
    vehicles = np.shape(log.traffic.valid)[-1:]
    rows = {
        "centre": (log.centre, (2,)),
        "road_margin": (log.road_margin, ()),
        "ego.position": (log.ego.position, (2,)),
    }
    rows |= {"ego.speed": (log.ego.speed, ()), "traffic.position": (log.traffic.position, (*vehicles, 2))}
    for name, (values, rest) in rows.items():
        if np.shape(values) != (*shape, *rest):
            raise ScenarioError(
                f"log.{name} has the shape {np.shape(values)}, and log.time {shape}: it must be of that run"
            )
    known = log.time, log.ego, log.centre, log.road_margin
    if traced(known):
        return
    if not all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(known)) or np.any(np.diff(log.time) <= 0):
        raise ScenarioError("log: its times do not rise, or the ego is not finite somewhere; no score is defined")
