"""A recorded drive along a course: the truth of where the vehicle was, what its wheels said, and who was around."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from urbanjax.roadmap.corridor import Corridor
from urbanjax.roadmap.progress import sample, to_world
from urbanjax.sim.sensing import WheelErrors
from urbanjax.types import POSITIVE, Objects, Odometry, VehicleState, field, pytree, static
from urbanjax.vehicle.params import VehicleParams

LENGTH, WIDTH = 4.5, 1.8  # m, of the vehicles around
START_SPEED = 1.0  # m/s: from standstill the first step would take for ever
LEAST_CURVATURE = 1e-6  # 1/m, below which a road is straight


@pytree
class TourParams:
    """How the course is driven, and through what traffic."""

    speed: float = 60 / 3.6  # m/s, on straights
    lateral: float = 2.5  # m/s^2, that curves are driven with at most
    acceleration: float = 1.5  # m/s^2
    deceleration: float = 2.0  # m/s^2
    offset: float = 0.0  # m, left of the route's lane
    wheels: WheelErrors = WheelErrors()
    traffic_speed: tuple[float, float] = (6.0, 14.0)  # m/s
    traffic_reach: float = 90.0  # m ahead and behind, within which vehicles stay
    vehicles: int = static(default=20)
    period: float = field(default=0.1, metadata=POSITIVE)  # s


@pytree
class Tour:
    """T steps, `period` s apart."""

    time: Array  # [T] s
    station: Array  # [T] m along the course
    ego: VehicleState  # [T]
    yaw_rate: Array  # [T] rad/s, the true one
    odometry: Odometry  # [T], with bias and noise
    vehicles: Objects  # [T, O]


def drive(key: Array, corridor: Corridor, *, params: TourParams, vehicle: VehicleParams | None = None) -> Tour:
    """The drive along a whole route, as fast as speed limit and curves allow; on the host.

    Vehicles drive on the lanes beside the ego's, at speeds of their own; one that is left behind comes up again in
    front, so that there are always as many. On the ego's lane there is nobody. Args: key, of noise and traffic;
    corridor, the lanes along the route; vehicle, its dimensions (default: the standard one).
    """
    vehicle = VehicleParams() if vehicle is None else vehicle
    station, speed, time = _profile(
        np.asarray(corridor.station), np.asarray(corridor.curvature), float(corridor.length), params
    )
    position, heading, curvature = to_world(
        corridor, jnp.asarray(station), offset=jnp.full(len(station), params.offset)
    )
    keys = jax.random.split(key, 4)
    acceleration = jnp.asarray(np.gradient(speed, time), position.dtype)
    speed = jnp.asarray(speed, position.dtype)
    yaw_rate = speed * curvature
    steering = jnp.arctan(vehicle.wheelbase * curvature)
    rolled, turned = params.wheels.on(speed, yaw_rate, keys=keys)
    return Tour(
        time=jnp.asarray(time, position.dtype),
        station=jnp.asarray(station, position.dtype),
        ego=VehicleState(position, heading, speed, acceleration, steering),
        yaw_rate=yaw_rate,
        odometry=Odometry(rolled, acceleration, steering, turned),
        vehicles=_traffic(keys[2], corridor, jnp.asarray(station), jnp.asarray(time), params),
    )


def _profile(
    station: np.ndarray, curvature: np.ndarray, length: float, params: TourParams
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Station, speed and time [T] at each step, from walking pace and the caps of the curves."""
    inside = station <= length
    station, curvature = station[inside], np.abs(curvature[inside])
    squared = np.minimum(params.speed**2, params.lateral / np.maximum(curvature, LEAST_CURVATURE))
    squared[0] = START_SPEED**2
    gap = np.diff(station)
    for i, step in enumerate(gap):
        squared[i + 1] = min(squared[i + 1], squared[i] + 2 * params.acceleration * step)
    for i in range(len(gap) - 1, -1, -1):
        squared[i] = min(squared[i], squared[i + 1] + 2 * params.deceleration * gap[i])
    speed = np.sqrt(squared)
    passed = np.concatenate([[0], np.cumsum(2 * gap / (speed[1:] + speed[:-1]))])
    time = np.arange(0, passed[-1], float(params.period))
    return np.interp(time, passed, station), np.interp(time, passed, speed), time


def _traffic(key: Array, corridor: Corridor, station: Array, time: Array, params: TourParams) -> Objects:
    """Boxes [T, O] on the lanes beside the route's."""
    n = params.vehicles
    keys = jax.random.split(key, 4)
    low, high = params.traffic_speed
    speed = jax.random.uniform(keys[0], (n,), minval=low, maxval=high)
    phase = jax.random.uniform(keys[1], (n,), maxval=2 * params.traffic_reach)
    lane = jax.random.randint(keys[2], (n,), 0, corridor.lane_offset.shape[1] - 1)
    lane = jnp.where(lane >= corridor.route_lane, lane + 1, lane)
    ahead = phase[None, :] + speed[None, :] * time[:, None] - station[:, None]
    there = station[:, None] + jnp.mod(ahead, 2 * params.traffic_reach) - params.traffic_reach

    def place(where: Array) -> tuple[Array, Array, Array]:
        at = sample(corridor, where)
        offset = jnp.take_along_axis(at.lane_offset, lane[:, None], axis=1)[:, 0]
        oncoming = jnp.take_along_axis(at.oncoming, lane[:, None], axis=1)[:, 0]
        valid = jnp.take_along_axis(at.has_lane, lane[:, None], axis=1)[:, 0] & ~oncoming
        left = jnp.stack([-jnp.sin(at.heading), jnp.cos(at.heading)], axis=-1)
        return at.position + offset[:, None] * left, at.heading, valid

    position, heading, valid = jax.jit(jax.vmap(place))(there)
    shape = heading.shape
    size = jnp.ones(shape, heading.dtype)
    return Objects(position, heading, jnp.broadcast_to(speed[None], shape), LENGTH * size, WIDTH * size, valid)
