"""The whole pipeline on one screen: observation in, command out."""

from typing import Any, ClassVar

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
from urbanjax.localization.relocalize import RelocalizeParams
from urbanjax.localization.types import Localization
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning import plan as plans
from urbanjax.planning import situation as situations
from urbanjax.planning.params import PlanningParams
from urbanjax.planning.plan import Memory, Plan
from urbanjax.planning.situation import Situation, SituationParams
from urbanjax.roadmap.progress import progress
from urbanjax.types import HANDED_DOWN, Command, ConfigError, Mount, Observation, Unread, field, pytree, static
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.params import VehicleParams

# What only degrees of choices depend on, what only matching a track needs, and what only the macro plan asks.
RELAXED = ("relaxation.temperature", "planning.*_scale", "behavior.*_scale", "behavior.lanes.clear_difference")
MATCHING = ("situation.locate.connectivity_penalty", "situation.locate.hysteresis")
FOLLOWERS = ("planning.micro.clearance.follower_*", "behavior.clearance.follower_*")


@pytree
class StackParams:
    """Every parameter of the stack."""

    UNREAD: ClassVar[dict[str, Unread | None]] = {
        "lidar": Unread("only the localizer 'lidar' does, see 'localizer'", lambda p: p.localizer != "lidar"),
        "search": Unread("nobody who is lost is searched for here"),  # but in experiments.evaluate
        **dict.fromkeys(MATCHING, Unread("the stack keeps to its route instead of matching its track")),
        **dict.fromkeys(FOLLOWERS, Unread("only the macro plan does, see 'planning.macro.clearance'")),
        **dict.fromkeys(
            RELAXED, Unread("only relaxed choices do, see 'relaxation.mode'", lambda p: p.relaxation.mode == "hard")
        ),
    }

    PINNED: ClassVar[dict[str, str]] = {
        "lidar": "fact: where the vehicle is; calibrated against known poses, in experiments.register",
        "search": "fact: where the vehicle is; calibrated against known poses",
    }

    vehicle: VehicleParams = field(default=None, metadata=HANDED_DOWN)
    period: float = field(default=None, metadata=HANDED_DOWN)  # s, of one step
    mount: Mount = field(default=None, metadata=HANDED_DOWN)  # of the LiDAR
    situation: SituationParams = SituationParams()
    planning: PlanningParams = PlanningParams()
    behavior: BehaviorParams = BehaviorParams()
    control: ControlParams = ControlParams()
    lidar: LidarLocalizerParams = LidarLocalizerParams()  # of the localizer 'lidar'
    search: RelocalizeParams = RelocalizeParams()  # for its pose where it is lost, see `recover`
    relaxation: Relaxation = Relaxation()
    localizer: str = static(default="given", metadata={"choices": tuple(LOCALIZERS)})

    def driving(self, params: Any) -> Driving:
        """What a stage works with. Args: params, of the stage. Raises ConfigError where nothing was handed down."""
        if self.vehicle is None or self.period is None:
            raise ConfigError(
                "StackParams.vehicle and .period are None: set them, or take LoopParams().handed_down()[0]"
            )
        return Driving(self.vehicle, params, self.relaxation, self.period)

    def localizing(self) -> LidarLocalizerParams:
        """The params of the localizer, with what it has to agree on with the others."""
        return self.lidar and self.lidar.replace(mount=self.mount, period=self.period)

    def init(self, course: Course, pose: jaxlie.SE2) -> "StackState":
        """The stack as a driver: `stack.init`. Args: course, of the drive; pose, T_world_body of the rear axle."""
        return init(self, course, pose)

    def step(
        self, course: Course, state: "StackState", observation: Observation
    ) -> tuple[Command, "StackState", "StackInfo"]:
        """The stack as a driver: `stack.step`.

        Args: course, of the drive; state, what is remembered; observation, of this step.
        """
        return step(self, course, state, observation)


@pytree
class StackState:
    """What the stack carries from step to step."""

    station: Array  # [] m, progress on the route
    plan: Memory
    select: SelectState
    localizer: Any = None  # what the localizer carries


@pytree
class StackInfo:
    """What each stage came to; reported, never fed back."""

    localization: Localization
    situation: Situation
    plan: Plan
    choice: Choice
    speed_plan: SpeedPlan


def init(params: StackParams, course: Course, pose: jaxlie.SE2) -> StackState:
    """The state before the first step.

    Args: course, of the drive; pose, T_world_body of the rear axle, near its route.
    """
    whole = progress(course.corridor, pose.translation(), heading=pose.rotation().as_radians())
    return StackState(
        station=whole.station,
        plan=plans.nothing(params.planning),
        select=tsps.init(whole, course.corridor),
        localizer=LOCALIZERS[params.localizer].init(params.localizing(), course, pose),
    )


def step(
    params: StackParams, course: Course, state: StackState, observation: Observation
) -> tuple[Command, StackState, StackInfo]:
    """One step: command, next state, and the info of every stage. Pure; jit, vmap, scan and grad it.

    Differentiable with respect to params, state and observation in the modes `soft` and `straight_through` of
    `params.relaxation`, and in mode `hard` through everything but the choices. Args: course, of the drive; state, what
    is remembered; observation, of this step.
    """
    driving = params.driving(params.behavior)
    with jax.named_scope("localization"):
        localizer = LOCALIZERS[params.localizer]
        localization, localized = localizer.step(params.localizing(), course, state.localizer, observation)
        ego, observation = localization.vehicle_state(observation.odometry), localization.in_world(observation)
    situation = situations.look(params.situation, course, station=state.station, ego=ego, observation=observation)
    plan = plans.plan(situation, driving.of(params.planning), memory=state.plan)
    with jax.named_scope("tsps"):
        select, choice = tsps.select(situation, driving, plan=plan, state=state.select)
    with jax.named_scope("gvp"):
        speed_plan = speed.plan(choice, driving)
    with jax.named_scope("control"):
        command = drive.follow(
            choice.path,
            driving.of(params.control),
            reference=speed_plan.reference,
            emergency=localization.brake(speed_plan.emergency),
            state=ego,
        )
    following = StackState(situation.progress.station, plans.remember(plan), select, localized)
    return command, following, StackInfo(localization, situation, plan, choice, speed_plan)


def recover(params: StackParams, course: Course, *, state: StackState, observation: Observation) -> StackState:
    """The state with the pose searched for anew where it is lost; as it is otherwise.

    Rare and heavy, so that the loop around calls it every now and then, and outside `vmap`, where the search would run
    each time. The gradient is of no use. Args: course, of the drive; state, what is remembered; observation, that of
    the step to come, with a scan.
    """
    localizer = LOCALIZERS[params.localizer]
    found = localizer.recover(params.localizing(), params.search, course, state.localizer, observation)
    return state.replace(localizer=found)
