"""Following a vehicle in a single lane; in some starts it has to stop behind a standing one."""

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

LANE = 0  # the only link
LEADER, STANDING = 0, 1  # vehicles


@pytree
class FollowParams:
    """Ranges from which starts are drawn, uniformly."""

    length: float = static(default=800.0)  # m, of the road
    lane_width: float = static(default=3.5)  # m
    speed_limit: float = static(default=50 / 3.6)  # m/s
    n_vehicles: int = static(default=4)  # padded
    start: float = 60.0  # m, station of the ego's rear axle
    ego_speed: tuple[float, float] = (6.0, 13.0)  # m/s
    leader_speed: tuple[float, float] = (4.0, 12.0)  # m/s
    gap: tuple[float, float] = (20.0, 50.0)  # m, bumper to bumper
    stops: float = field(default=0.5, metadata=SHARE)  # share of starts with a standing vehicle
    stop_gap: tuple[float, float] = (80.0, 160.0)  # m, from the leader to the standing vehicle


def road(params: FollowParams) -> RoadGraph:
    """The road: one lane along y = 0."""
    kind(params, "params", wanted=FollowParams, error=ScenarioError)
    return straight(1, params.length, style=RoadStyle(lane_width=params.lane_width, speed_limit=params.speed_limit))


def sample(key: Array, params: FollowParams, *, vehicle: VehicleParams, others: TrafficParams) -> Scenario:
    """A start: the ego behind a leader that keeps its speed, or brakes behind a standing vehicle.

    Args: key, of chance; vehicle, the ego's dimensions; others, how traffic drives.
    """
    told = {"vehicle": (vehicle, VehicleParams), "others": (others, TrafficParams)}
    kinds({"key": (key, Array), "params": (params, FollowParams), **told}, error=ScenarioError)
    keys = jax.random.split(key, 5)

    def draw(i: int, limits: tuple[float | Array, float | Array]) -> Array:
        return jax.random.uniform(keys[i], (), minval=limits[0], maxval=limits[1])

    speed, leader_speed = draw(0, params.ego_speed), draw(1, params.leader_speed)
    stops = jax.random.uniform(keys[3], ()) < params.stops
    front = params.start - vehicle.rear_overhang + vehicle.length
    leader = front + draw(2, params.gap) + 0.5 * others.vehicle_length
    pad = params.n_vehicles - 2
    zeros = jnp.zeros(pad, speed.dtype)
    vehicles = traffic(
        jnp.full(params.n_vehicles, LANE, jnp.int32),
        jnp.concatenate([jnp.stack([leader, leader + draw(4, params.stop_gap)]), zeros]),
        speed=jnp.concatenate([jnp.stack([leader_speed, jnp.zeros_like(speed)]), zeros]),
        limit=params.speed_limit,
        params=others,
        valid=jnp.concatenate([jnp.stack([jnp.asarray(True), stops]), jnp.zeros(pad, bool)]),
    )
    ego = ego_at(jnp.asarray(params.start, speed.dtype), jnp.zeros_like(speed), speed=speed)
    link = jnp.asarray(LANE, jnp.int32)
    return Scenario(world(ego, LANE, vehicles=vehicles), link, link, jnp.asarray(False))
