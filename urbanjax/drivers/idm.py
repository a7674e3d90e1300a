"""The driver that keeps to its lane behind whoever is ahead in it."""

import jax.numpy as jnp
import jaxlie
from jax import Array
from jaxtyping import Float

from urbanjax.behavior.situation import closed_line
from urbanjax.behavior.surroundings import relate
from urbanjax.control.pure_pursuit import PurePursuitParams, steer
from urbanjax.course import Course
from urbanjax.localization import given
from urbanjax.numerics import safe
from urbanjax.numerics.soft import Relaxation
from urbanjax.roadmap.corridor import Corridor, WindowParams, window
from urbanjax.roadmap.progress import Progress, progress, to_world
from urbanjax.types import (
    HANDED_DOWN,
    Command,
    Objects,
    Observation,
    Path,
    VehicleState,
    field,
    pytree,
)
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.following import IDMParams, free_acceleration, interaction
from urbanjax.vehicle.limits import approach_speed, curve_speed
from urbanjax.vehicle.params import VehicleParams

AHEAD = 121  # points of the path, a metre apart


@pytree
class IdmDriver:
    """Follows the centre of the route's lane with the intelligent driver model, as nuPlan's baseline does.

    It never changes lanes but where its route does, stops at signals that are not green, and slows down for bends.
    """

    vehicle: VehicleParams = field(default=None, metadata=HANDED_DOWN)
    period: float = field(default=None, metadata=HANDED_DOWN)  # s, of one step
    following: IDMParams = IDMParams()
    pursuit: PurePursuitParams = PurePursuitParams()
    window: WindowParams = WindowParams()
    lateral_acceleration: float = 2.5  # m/s^2, most in bends
    margin: float = 0.3  # m beside both bodies, within which somebody is in the way
    stop_margin: float = 1.5  # m, before a stop line

    def init(self, course: Course, pose: jaxlie.SE2) -> Array:
        """The station [] m on the route. Args: course, of the drive; pose, T_world_body of the rear axle."""
        return progress(course.corridor, pose.translation(), heading=pose.rotation().as_radians()).station

    def step(self, course: Course, state: Array, observation: Observation) -> tuple[Command, Array, Progress]:
        """One step. Args: course, of the drive; state, the station [] m; observation, with the pose."""
        ego = given.step(observation).vehicle_state(observation.odometry)
        road = window(course.corridor, state, params=self.window)
        here = progress(road, ego.position, heading=ego.heading)
        path = _lane(road, here)
        driving = Driving(self.vehicle, self.pursuit, Relaxation(), self.period)
        command = Command(
            acceleration=self._accelerate(road, here, ego, path, observation),
            steering=steer(path, driving, state=ego),
        )
        return command, here.station, here

    def _accelerate(
        self, road: Corridor, here: Progress, ego: VehicleState, path: Path, observation: Observation
    ) -> Float[Array, ""]:
        """IDM's, behind the nearest one ahead and before the next stop line."""
        params = self.following
        limit = jnp.interp(here.station, road.station, road.speed_limit)
        bends = curve_speed(path.curvature, self.lateral_acceleration, cap=limit)
        desired = safe.minimum(approach_speed(path.station - here.station, bends, deceleration=params.deceleration))
        front = here.station + self.vehicle.length - self.vehicle.rear_overhang
        gap, speed, there = self._leaders(road, observation.objects, front)
        line, red = closed_line(road, observation.signals, front=front)
        to_line = jnp.where(red, line - front, 0)
        gaps = jnp.concatenate([gap, (to_line - self.stop_margin + params.jam_distance)[None]])
        speeds = jnp.concatenate([speed, jnp.zeros_like(to_line)[None]])
        ahead = jnp.concatenate([there, red[None]])
        own = jnp.broadcast_to(ego.speed, gaps.shape)
        braking = jnp.where(ahead, interaction(own, gaps, front_speed=speeds, params=params), 0)
        wanted = free_acceleration(ego.speed, desired, params=params) - safe.maximum(braking, 0)
        stopping = -ego.speed / self.period  # no faster than to a stand
        low = jnp.maximum(-self.vehicle.max_deceleration, jnp.minimum(stopping, 0))
        return jnp.clip(wanted, low, self.vehicle.max_acceleration)

    def _leaders(self, road: Corridor, objects: Objects, front: Array) -> tuple[Array, Array, Array]:
        """Gap [O] m, speed along the road [O] m/s, and whether each object is ahead in the lane's way [O]."""
        around = relate(objects, road)
        reach = around.half_width + self.vehicle.width / 2 + self.margin
        ahead = around.valid & (jnp.abs(around.offset) < reach) & (around.station + around.half_length > front)
        return around.station - around.half_length - front, around.speed, ahead


def _lane(road: Corridor, here: Progress) -> Path:
    """The centre of the route's lane from here on."""
    station = here.station + road.spacing * jnp.arange(AHEAD, dtype=here.station.dtype)
    nothing = jnp.zeros_like(station)
    position, heading, curvature = to_world(road, station, offset=nothing)
    return Path(station, nothing, position, heading, curvature)
