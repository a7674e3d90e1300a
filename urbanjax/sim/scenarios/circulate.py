"""Mixed traffic spread over a whole road network, as on the district course."""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.roadmap.builders import district
from urbanjax.roadmap.graph import RoadGraph, RoadType
from urbanjax.sim import lanes as roads
from urbanjax.sim.agents import Traffic, TrafficParams
from urbanjax.sim.lanes import LaneTables
from urbanjax.sim.scenarios.scenario import Scenario, traffic
from urbanjax.sim.signals import alternating
from urbanjax.sim.world import WorldState
from urbanjax.types import POSITIVE, ScenarioError, VehicleState, field, pytree, static
from urbanjax.types.arguments import kinds

START_SHARE = 0.6  # of the wanted speed, at which vehicles start
NEVER = 2.0  # above all random numbers, for places that are not to be chosen


@pytree
class CirculateParams:
    """How traffic is spread, and what drivers want."""

    n_vehicles: int = static(default=32)
    spacing: float = 16.0  # m, between two starting places in one lane
    n_places: int = static(default=6)  # starting places per link, at most
    ego_link: int = static(default=1)  # where the ego starts
    ego_station: float = 20.0  # m along that link
    ego_speed: float = 8.0  # m/s
    factor: tuple[float, float] = (0.6, 1.1)  # wanted speed as a share of the limit
    headway: tuple[float, float] = (0.9, 1.8)  # s
    signal_cycle: float = field(default=60.0, metadata=POSITIVE)  # s


def road(params: CirculateParams) -> RoadGraph:
    """The district."""
    return district()


def sample(key: Array, params: CirculateParams, *, others: TrafficParams, lanes: LaneTables) -> Scenario:
    """A start: `n_vehicles` on random free places of the network, which change lanes and take the first successor.

    No vehicle starts inside a junction, or within one spacing of the ego. Args: key, of chance; others, how
    traffic drives; lanes, the simulator's tables of the road.
    """
    told = {"others": (others, TrafficParams), "lanes": (lanes, LaneTables)}
    kinds({"key": (key, Array), "params": (params, CirculateParams), **told}, error=ScenarioError)
    keys = jax.random.split(key, 4)
    link = jnp.asarray(params.ego_link, jnp.int32)
    start = roads.at(lanes, link[None], station=jnp.asarray(params.ego_station)[None])[0]
    position, heading = start[: roads.HEADING], start[roads.HEADING]
    zero = jnp.zeros_like(heading)
    ego = VehicleState(position, heading, zero + params.ego_speed, zero, zero)
    vehicles = scatter(keys[0], lanes, params=params, others=others, keep_free=position)
    n = params.n_vehicles
    factor = jax.random.uniform(keys[1], (n,), minval=params.factor[0], maxval=params.factor[1])
    headway = jax.random.uniform(keys[2], (n,), minval=params.headway[0], maxval=params.headway[1])
    limit = lanes.graph.speed_limit[vehicles.link]
    vehicles = vehicles.replace(
        speed=START_SHARE * factor * limit, desired_speed=factor, headway=headway, changes=jnp.ones(n, bool)
    )
    program = alternating(lanes.graph.n_signals, cycle=params.signal_cycle)
    state = WorldState(ego, link, vehicles, program, zero, jnp.asarray(0, jnp.int32))
    return Scenario(state, link, lanes.graph.predecessor[link, 0].astype(jnp.int32), jnp.asarray(True))


def scatter(
    key: Array, lanes: LaneTables, *, params: CirculateParams, others: TrafficParams, keep_free: Float[Array, "2"]
) -> Traffic:
    """Vehicles at distinct random places, which are `spacing` apart along each link.

    Args: key, of chance; lanes, the simulator's tables of the road; others, how traffic drives; keep_free [2] m, a
    position that no vehicle is near.
    """
    graph = lanes.graph
    station = (0.5 + jnp.arange(params.n_places, dtype=graph.length.dtype)) * params.spacing
    link = jnp.repeat(jnp.arange(graph.length.shape[0], dtype=jnp.int32), params.n_places)
    station = jnp.tile(station, graph.length.shape[0])
    inside = station + 0.5 * params.spacing <= graph.length[link]
    row = roads.at(lanes, link, station=station)
    away = jnp.sum((row[:, : roads.HEADING] - keep_free[None, :]) ** 2, axis=-1) > params.spacing**2
    open_road = graph.valid[link] & (graph.road_type[link] != RoadType.JUNCTION) & ~lanes.ends[link]
    usable = inside & away & open_road
    order = jnp.where(usable, jax.random.uniform(key, usable.shape), NEVER)
    chosen = jnp.argsort(order)[: params.n_vehicles]
    link, station = link[chosen], station[chosen]
    # The limit does not matter for wanted speeds of 0.
    return traffic(link, station, speed=jnp.zeros_like(station), limit=1.0, params=others, valid=usable[chosen])
