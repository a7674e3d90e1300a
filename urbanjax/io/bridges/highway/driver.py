"""Our stack at the wheel of a highway-env vehicle."""

import functools
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import jaxlie
import numpy as np

from urbanjax import stack
from urbanjax.control.drive import ControlParams
from urbanjax.control.longitudinal import LongitudinalParams
from urbanjax.io.bridges.highway.environment import FREQUENCY, action_of
from urbanjax.io.bridges.highway.network import read_network
from urbanjax.io.bridges.highway.route import Destination, ahead, course_to, shared_ground, toward
from urbanjax.numerics.compiling import compiler_options
from urbanjax.roadmap.corridor import CorridorParams
from urbanjax.roadmap.locate import locate
from urbanjax.stack import StackInfo, StackParams
from urbanjax.types import Objects, Observation, Odometry, Signals, as_arrays, pytree, static
from urbanjax.vehicle.params import VehicleParams

CAR = VehicleParams(
    wheelbase=5.0,
    length=5.0,
    width=2.0,
    rear_overhang=0.0,
    max_acceleration=3.0,
    max_deceleration=6.0,
    max_steering=0.6,
)  # highway-env turns about a point half a length behind the centre

# Traffic there brakes at up to 9 m/s^2 and shows no lights: comfort ends where the brakes do.
SAME_PLACE = 0.1  # m beyond the nearest distance: stations of other laps at the same place
DETOUR = 1.0  # m that a way may cost more and still count as no dearer
BRAKES = LongitudinalParams(comfort_deceleration=6.0)
HIGHWAY_STACK = StackParams(control=ControlParams(longitudinal=BRAKES))


@pytree
class DriverParams:
    """How our stack is put into highway-env."""

    range: float = static(default=150.0)  # m, within which vehicles are seen
    n_objects: int = static(default=16)  # the nearest ones
    settle_time: float = static(default=1.0)  # s in another lane before the route follows it there
    settle_offset: float = static(default=0.6)  # m from that lane's centre
    reach: float = static(default=1600.0)  # m, length of the road ahead that is planned for
    max_link: float = static(default=1700.0)  # m
    corridor: CorridorParams = CorridorParams(n_stations=3600)


class StackDriver:
    """Drives the ego of a highway-env environment; one compiled step for all networks of one size bucket."""

    def __init__(self, stack_params: StackParams, params: DriverParams, vehicle: VehicleParams = CAR):
        """Drive with `stack_params`, of the kind of `HIGHWAY_STACK`. Args: vehicle, the one to be driven."""
        self.params = params.replace(corridor=as_arrays(params.corridor))
        self.stack = as_arrays(stack_params.replace(vehicle=vehicle, period=1.0 / FREQUENCY))
        self.step_seconds: list[float] = []
        self.info: StackInfo | None = None

    def start(self, env: Any) -> None:
        """Plan the way and compile what the drive will need."""
        self.plan(env)
        jax.block_until_ready(_step()(self.stack, self.course, self.state, self.observe(env)))

    def plan(self, env: Any) -> None:
        """Read the road and plan the way to the ego's goal or ahead."""
        self.graph, self.keys = read_network(env.road.network, max_link=self.params.max_link, buckets=True)
        self.shared = shared_ground(self.graph)
        self.command = (0.0, 0.0)
        self.step_seconds = []
        link = self._link(env)
        self.destination = self._destination(env, link)
        self._follow(env, link)

    def act(self, env: Any) -> np.ndarray:
        """The action of this step."""
        observation = self.observe(env)
        began = time.perf_counter()
        command, self.state, self.info = _step()(self.stack, self.course, self.state, observation)
        self.command = float(command.acceleration), float(command.steering)
        self.step_seconds.append(time.perf_counter() - began)
        self._settle(env)
        return action_of(*self.command)

    def observe(self, env: Any) -> Observation:
        """What the stack is told: pose of the rear axle, odometry, the nearest vehicles and obstacles; y up."""
        ego, dtype = env.vehicle, jnp.zeros(()).dtype
        heading, acceleration, steering = -ego.heading, *self.command
        direction = np.array([np.cos(heading), np.sin(heading)])
        rear = ego.position * np.array([1.0, -1.0]) - 0.5 * ego.LENGTH * direction
        # The simulator moves the centre, at an angle to the body; the rear axle moves along it.
        speed = ego.speed * np.cos(np.arctan(0.5 * np.tan(steering)))
        odometry = Odometry(speed, acceleration, steering, speed * np.tan(steering) / ego.LENGTH)
        pose = np.array([np.cos(heading), np.sin(heading), *rear])
        none = jnp.zeros(0)
        return Observation(
            odometry=jax.tree.map(lambda x: np.asarray(x, dtype), odometry),
            objects=_nearest(env, self.params.range, self.params.n_objects, dtype),
            signals=Signals(none.astype(jnp.int32), none, none.astype(bool)),
            pose=jaxlie.SE2(np.asarray(pose, dtype)),
        )

    def _link(self, env: Any) -> int:
        """The link that the ego is on."""
        observation = self.observe(env)
        pose = observation.pose
        position, heading = pose.translation()[None], pose.rotation().as_radians()[None]
        return int(_locate(self.graph, position, heading, self.stack.situation.locate).link[0])

    def _destination(self, env: Any, link: int) -> Destination:
        """The last road of the ego's route in any of its lanes, or the road ahead of `link` where it has no route."""
        if not env.vehicle.route:
            return ahead(self.graph, link, reach=self.params.reach)
        road = tuple(env.vehicle.route[-1][:2])
        last = {key[2]: i for i, key in enumerate(self.keys) if key[:2] == road and key[3] >= 0}  # pieces are in order
        return toward(self.graph, list(last.values()), reach=self.params.reach)

    def _follow(self, env: Any, link: int) -> None:
        """Take the route that begins on `link`."""
        self.course = course_to(self.graph, link, destination=self.destination, params=self.params.corridor)
        corridor = self.course.corridor
        self.state = _init(self.stack, self.course, self.observe(env).pose)
        if self.destination.laps > 1:  # every lap passes here: begin with the first
            away = np.linalg.norm(
                np.asarray(corridor.position) - np.asarray(self.observe(env).pose.translation()), axis=-1
            )
            first = float(corridor.station[int(np.argmax(away < away.min() + SAME_PLACE))])
            self.state = self.state.replace(station=jnp.full_like(self.state.station, first))
        self.lanes = jax.tree.map(np.asarray, (corridor.lane_link, corridor.lane_offset, corridor.has_lane))
        self.settled = 0

    def _settle(self, env: Any) -> None:
        """Move the route to the lane that the ego has settled in, where that needs no more lane changes.

        Never to a lane on the ground of oncoming traffic: from there the way back must stay planned.
        """
        progress = self.info.situation.progress
        station, offset = (float(value) for value in (progress.station, progress.offset))
        links, offsets, has = self.lanes
        row = int(np.clip(round(station / self.course.corridor.spacing), 0, len(links) - 1))
        lane = int(np.argmin(np.where(has[row], np.abs(offsets[row] - offset), np.inf)))
        link, own = int(links[row, lane]), int(links[row, self.course.corridor.route_lane])
        near = abs(offsets[row, lane] - offset) < self.params.settle_offset
        cheaper = self.destination.best(link)[1] <= self.destination.best(own)[1] + DETOUR
        free = link != own and near and cheaper and not self.shared[link]
        self.settled = self.settled + 1 if free else 0
        if self.settled > self.params.settle_time * FREQUENCY:
            self._follow(env, link)


def _nearest(env: Any, reach: float, count: int, dtype: Any) -> Objects:
    """The nearest solid things within reach, nearest first, padded to `count`; y up."""
    ego = env.vehicle
    things = [thing for thing in [*env.road.vehicles, *env.road.objects] if thing is not ego and thing.solid]
    rows = np.array([(*t.position, t.heading, t.speed, t.LENGTH, t.WIDTH) for t in things], float).reshape(-1, 6)
    distance = np.linalg.norm(rows[:, :2] - ego.position, axis=-1)
    chosen = rows[np.argsort(distance)[: min(count, int(np.sum(distance < reach)))]]
    table = np.zeros((count, 6))
    table[:, 4:] = 1.0
    table[: len(chosen)] = chosen * [1.0, -1.0, -1.0, 1.0, 1.0, 1.0]
    columns = [table[:, :2], *(table[:, i] for i in range(2, 6))]
    return Objects(*(np.asarray(column, dtype) for column in columns), valid=np.arange(count) < len(chosen))


@functools.cache
def _step() -> Callable[..., tuple]:
    return jax.jit(stack.step, compiler_options=compiler_options())


_init = jax.jit(stack.init)
_locate = jax.jit(lambda graph, position, heading, params: locate(graph, position, heading=heading, params=params))
