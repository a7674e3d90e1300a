"""A start on a straight road, moved onto a place of another road."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int

from urbanjax.sim import lanes as roads
from urbanjax.sim.lanes import LaneTables
from urbanjax.sim.scenarios.overtake import RIGHT
from urbanjax.sim.scenarios.scenario import Scenario
from urbanjax.sim.signals import alternating
from urbanjax.types import VehicleState

CROSSED = 4  # links that a vehicle may be ahead of the ego


def transplant(
    start: Scenario, lanes: LaneTables, *, link: Int[Array, ""], shift: float | Array, cycle: float = 60.0
) -> Scenario:
    """An overtaking start (`overtake.sample`) with its right lane on `link` and its left lane on that one's left.

    Vehicles that stand beyond the end of the link stand on those that follow it. Args: start, drawn by
    `overtake.sample`; lanes, the simulator's tables of the other road; link, which has a left neighbour; shift [m],
    added to all stations; cycle [s], of the signals there.
    """
    traffic, ego = start.world.traffic, start.world.ego
    left = lanes.graph.left_link[link].astype(jnp.int32)
    own = jnp.where(traffic.link == RIGHT, link.astype(jnp.int32), left)
    where, station = _onwards(lanes, own, traffic.station + shift)
    row = roads.at(lanes, link[None].astype(jnp.int32), station=(ego.position[0] + shift)[None])[0]
    heading = row[roads.HEADING]
    placed = VehicleState(row[: roads.HEADING], heading, ego.speed, ego.acceleration, ego.steering)
    vehicles = traffic.replace(link=where, station=station, other=where)
    world = start.world.replace(
        ego=placed,
        ego_link=link.astype(jnp.int32),
        traffic=vehicles,
        signals=alternating(lanes.graph.n_signals, cycle=cycle),
    )
    goal = lanes.graph.predecessor[link, 0].astype(jnp.int32)
    return Scenario(world, link.astype(jnp.int32), goal, start.crowded)


def _onwards(lanes: LaneTables, link: Int[Array, " v"], station: Float[Array, " v"]) -> tuple[Array, Array]:
    """Link and station of vehicles that follow their lane beyond its end."""
    for _ in range(CROSSED):
        length = lanes.graph.length[link]
        following, goes_on = roads.following(lanes, link, choice=jnp.zeros_like(link))
        beyond = (station > length) & goes_on
        link, station = jnp.where(beyond, following, link), jnp.where(beyond, station - length, station)
    return link, station
