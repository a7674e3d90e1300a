"""Overtaking a slow vehicle on a straight road with two lanes in one direction (the situation of Fig. 10)."""

import jax
import jax.numpy as jnp
from jax import Array

from urbanjax.roadmap.builders import straight
from urbanjax.roadmap.builders.specs import RoadStyle
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.sim.agents import TrafficParams
from urbanjax.sim.scenarios.scenario import Scenario, ego_at, traffic, world
from urbanjax.types import SHARE, ScenarioError, field, pytree, static
from urbanjax.types.arguments import kind, kinds
from urbanjax.vehicle.params import VehicleParams

LEFT, RIGHT = 0, 1  # links of the road
LEADER, BESIDE = 0, 1  # vehicles


@pytree
class OvertakeParams:
    """Ranges from which starts are drawn, uniformly."""

    length: float = static(default=800.0)  # m, of the road
    lane_width: float = static(default=3.5)  # m
    speed_limit: float = static(default=50 / 3.6)  # m/s, of both lanes
    n_vehicles: int = static(default=4)  # padded
    start: float = 60.0  # m, station of the ego's rear axle
    ego_speed: tuple[float, float] = (8.0, 14.0)  # m/s
    leader_speed: tuple[float, float] = (2.0, 6.0)  # m/s
    gap: tuple[float, float] = (15.0, 40.0)  # m, bumper to bumper
    crowded: float = field(default=0.5, metadata=SHARE)  # share of starts with a vehicle in the left lane
    beside_speed: tuple[float, float] = (8.0, 13.0)  # m/s
    behind_gap: tuple[float, float] = (8.0, 35.0)  # m, from the ego's rear bumper to that vehicle's front, if behind
    ahead_gap: tuple[float, float] = (0.0, 35.0)  # m, from the ego's front bumper to its rear, if ahead
    leader_reacts: bool = static(default=False)  # otherwise the leader keeps its speed whatever comes


def road(params: OvertakeParams) -> RoadGraph:
    """The road: link 0 is the left lane, link 1 the right one, whose centre is y = 0."""
    kind(params, "params", wanted=OvertakeParams, error=ScenarioError)
    return straight(2, params.length, style=RoadStyle(lane_width=params.lane_width, speed_limit=params.speed_limit))


def sample(key: Array, params: OvertakeParams, *, vehicle: VehicleParams, others: TrafficParams) -> Scenario:
    """A start: the ego in the right lane behind a slow leader, in some starts a vehicle in the left lane.

    Equal keys give equal starts, whatever drives the ego. Args: key, of chance; vehicle, the ego's dimensions; others,
    how traffic drives.
    """
    told = {"vehicle": (vehicle, VehicleParams), "others": (others, TrafficParams)}
    kinds({"key": (key, Array), "params": (params, OvertakeParams), **told}, error=ScenarioError)
    keys = jax.random.split(key, 7)

    def draw(i: int, limits: tuple[float | Array, float | Array]) -> Array:
        return jax.random.uniform(keys[i], (), minval=limits[0], maxval=limits[1])

    speed, leader_speed, gap = draw(0, params.ego_speed), draw(1, params.leader_speed), draw(2, params.gap)
    crowded = jax.random.uniform(keys[3], ()) < params.crowded
    behind = jax.random.bernoulli(keys[4])
    beside_speed = draw(5, params.beside_speed)
    rear = params.start - vehicle.rear_overhang
    front = rear + vehicle.length
    half = 0.5 * others.vehicle_length
    before = rear - draw(6, params.behind_gap) - half
    after = front + draw(6, params.ahead_gap) + half
    pad = params.n_vehicles - 2
    zeros = jnp.zeros(pad, speed.dtype)
    vehicles = traffic(
        jnp.concatenate([jnp.asarray([RIGHT, LEFT]), jnp.full(pad, RIGHT)]).astype(jnp.int32),
        jnp.concatenate([jnp.stack([front + gap + half, jnp.where(behind, before, after)]), zeros]),
        speed=jnp.concatenate([jnp.stack([leader_speed, beside_speed]), zeros]),
        limit=params.speed_limit,
        params=others,
        valid=jnp.concatenate([jnp.stack([jnp.asarray(True), crowded]), jnp.zeros(pad, bool)]),
    )
    vehicles = vehicles.replace(reacts=vehicles.reacts.at[LEADER].set(params.leader_reacts))
    ego = ego_at(jnp.asarray(params.start, speed.dtype), jnp.zeros_like(speed), speed=speed)
    links = jnp.asarray(RIGHT, jnp.int32)
    return Scenario(world(ego, RIGHT, vehicles=vehicles), links, links, crowded)
