"""The whole pipeline on one screen: observation in, command out."""

from typing import Any

import jax
import jaxlie
from jax import Array

from urbanjax.behavior import speed, tsps
from urbanjax.behavior.params import BehaviorParams
from urbanjax.behavior.speed import SpeedPlan
from urbanjax.behavior.tsps import Choice, SelectState
from urbanjax.control import drive
from urbanjax.control.drive import ControlParams
from urbanjax.course import Course
from urbanjax.localization.lidar import LidarLocalizerParams
from urbanjax.localization.localizers import LOCALIZERS
from urbanjax.localization.types import Localization
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning import macro, micro, prediction, previous, primitives
from urbanjax.planning.macro import MacroPlan
from urbanjax.planning.micro import MicroPlan
from urbanjax.planning.params import PlanningParams
from urbanjax.planning.previous import Previous
from urbanjax.roadmap.corridor import Progress, WindowParams, progress, window
from urbanjax.roadmap.locate import LocateParams, locate
from urbanjax.types import HANDED_DOWN, Command, ConfigError, Observation, Prediction, field, pytree, static
from urbanjax.vehicle.params import VehicleParams


@pytree
class StackParams:
    """Every parameter of the stack."""

    vehicle: VehicleParams = field(default=None, metadata=HANDED_DOWN)
    period: float = field(default=None, metadata=HANDED_DOWN)  # s, of one step
    mount: tuple[float, float, float, float] = field(
        default=None, metadata=HANDED_DOWN
    )  # of the LiDAR: x, y, z (m) above the ground, yaw (rad)
    window: WindowParams = WindowParams()
    locate: LocateParams = LocateParams()
    planning: PlanningParams = PlanningParams()
    behavior: BehaviorParams = BehaviorParams()
    control: ControlParams = ControlParams()
    lidar: LidarLocalizerParams = LidarLocalizerParams()  # of the localizer 'lidar'
    relaxation: Relaxation = Relaxation()
    localizer: str = static(default="given", metadata={"choices": tuple(LOCALIZERS)})


@pytree
class StackState:
    """What the stack carries from step to step."""

    station: Array  # [] m, progress on the route
    macro: Previous
    micro: Previous
    select: SelectState
    localizer: Any = None  # what the localizer carries


@pytree
class StackInfo:
    """What each stage came to; reported, never fed back."""

    localization: Localization
    progress: Progress
    prediction: Prediction
    macro: MacroPlan
    micro: MicroPlan
    choice: Choice
    speed: SpeedPlan


def init(params: StackParams, course: Course, pose: jaxlie.SE2) -> StackState:
    """The state before the first step. Args: course, of the drive; pose, T_world_body of the rear axle, near its route.

    Raises ConfigError where the vehicle or the period has not been handed down.
    """
    if params.vehicle is None or params.period is None:
        raise ConfigError("StackParams.vehicle and .period are None: set them, or take LoopParams().handed_down()[0]")
    whole = progress(course.corridor, pose.translation(), pose.rotation().as_radians())
    return StackState(
        station=whole.station,
        macro=previous.nothing(params.planning.macro.n_layers),
        micro=previous.nothing(params.planning.primitives.n_points),
        select=tsps.init(whole, course.corridor),
        localizer=LOCALIZERS[params.localizer].init(_lidar(params), course, pose),
    )


def step(
    params: StackParams, course: Course, state: StackState, observation: Observation
) -> tuple[Command, StackState, StackInfo]:
    """One step: command, next state, and the info of every stage. Pure; jit, vmap, scan and grad it.

    Differentiable with respect to params, state and observation in the modes `soft` and `straight_through` of
    `params.relaxation`, and in mode `hard` through everything but the choices.
    """
    vehicle, plan, relaxation = params.vehicle, params.planning, params.relaxation
    objects = observation.objects
    with jax.named_scope("localization"):
        localizer = LOCALIZERS[params.localizer]
        located, localized = localizer.step(_lidar(params), course, state.localizer, observation)
        ego = located.vehicle_state(observation.odometry)
    with jax.named_scope("route"):
        road = window(course.corridor, state.station, params.window)
        here = progress(road, ego.position, ego.heading)
    with jax.named_scope("prediction"):
        lanes = locate(course.graph, objects.position, objects.heading, params=params.locate)
        future = prediction.predict(course.graph, objects, lanes, plan.prediction)
    with jax.named_scope("macro"):
        wide = macro.plan(road, here, ego, future, state.macro, vehicle, plan.macro, relaxation)
    with jax.named_scope("primitives"):
        fan = primitives.generate(road, here, ego, wide, vehicle, plan.primitives)
    with jax.named_scope("micro"):
        near = micro.select(fan, future, state.micro, vehicle, plan.micro, relaxation)
    with jax.named_scope("tsps"):
        select, choice = tsps.select(
            road,
            here,
            ego,
            observation,
            future,
            wide.follower,
            near,
            state.select,
            vehicle,
            params.behavior,
            relaxation,
        )
    with jax.named_scope("gvp"):
        pace = speed.plan(choice, ego, vehicle, params.behavior, relaxation)
    with jax.named_scope("control"):
        command = drive.follow(
            choice.path, pace.reference, located.brake(choice.selection.emergency), ego, vehicle, params.control
        )
    following = StackState(
        station=here.station,
        macro=previous.remember(wide.station, wide.offset),
        micro=previous.remember(near.path.station, near.path.offset),
        select=select,
        localizer=localized,
    )
    return command, following, StackInfo(located, here, future, wide, near, choice, pace)


def _lidar(params: StackParams) -> Any:
    """The localizer's params with what it has to agree on."""
    return None if params.lidar is None else params.lidar.replace(mount=params.mount, period=params.period)
