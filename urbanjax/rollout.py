"""The closed loop: a driver in the simulator, as one scan. Here driver and simulator meet, nowhere else."""

import dataclasses
from collections.abc import Callable
from typing import Any, ClassVar

import jax
import jaxlie
from jax import Array

from urbanjax.course import Course
from urbanjax.numerics.kept import recomputed
from urbanjax.sim import log, world
from urbanjax.sim.checks import check_drive, check_start
from urbanjax.sim.lanes import LaneTables
from urbanjax.sim.lidar import LidarParams
from urbanjax.sim.log import Log
from urbanjax.sim.sensing import Sensing
from urbanjax.sim.world import HARD, SimParams, WorldState
from urbanjax.stack import StackInfo, StackParams
from urbanjax.types import HANDED_DOWN, POSITIVE, ConfigError, ScenarioError, Unread, field, pytree
from urbanjax.types.arguments import kind, kinds, short, whole
from urbanjax.vehicle.params import VehicleParams


@pytree
class LoopParams:
    """Everything that a closed loop depends on; vehicle, period and sensor are said here once and handed down."""

    UNREAD: ClassVar[dict[str, Unread | None]] = {
        "sensor": Unread(
            "only the localizer 'lidar' does, see 'stack.localizer'", lambda p: p.stack.localizer != "lidar"
        ),
        "sim.reaction.*_scale": Unread(
            "only relaxed choices do, see 'stack.relaxation.mode'", lambda p: p.stack.relaxation.mode == "hard"
        ),
    }

    PINNED: ClassVar[dict[str, str]] = {"period": "fact: of the computer that drives"}

    vehicle: VehicleParams = VehicleParams()  # the ego
    period: float = field(default=0.1, metadata=POSITIVE)  # s, of one step of the driver
    sensor: LidarParams = LidarParams()
    driver: Any = field(default=None, metadata=HANDED_DOWN)  # who drives, see `drivers.protocol`; None: the stack
    stack: StackParams = StackParams()
    sim: SimParams = SimParams()

    def loop(self) -> "LoopParams":
        """These alone, of a class that adds to them what an experiment asks."""
        return LoopParams(**{spec.name: getattr(self, spec.name) for spec in dataclasses.fields(LoopParams)})

    def handed_down(self) -> tuple[Any, SimParams]:
        """Driver and simulator with the vehicle, the period and the sensor of this loop.

        Raises ConfigError (when traced) where one of them holds its own.
        """
        driver = ("stack", self.stack) if self.driver is None else ("driver", self.driver)
        parts = {"vehicle": self.vehicle, "period": self.period, "mount": self.sensor.mount, "lidar": self.sensor}
        filled = []
        for name, part in (driver, ("sim", self.sim)):
            asked = [spec.name for spec in dataclasses.fields(part) if spec.metadata.get("handed_down")]
            for key in asked:
                if getattr(part, key) is not None:
                    raise ConfigError(f"'{name}.{key}' is said twice: leave it None and set it in LoopParams")
            filled.append(dataclasses.replace(part, **{key: parts[key] for key in asked}))
        return filled[0], filled[1]


def steps_of(duration: float, period: float) -> int:
    """Steps of a drive. Raises ConfigError where there are fewer than two. Args: duration, of it; period, of a step."""
    count = round(duration / period)
    if count < 2:
        raise ConfigError(f"'duration' is {duration:g} s and 'period' {period:g} s: a drive has two steps or more")
    return count


@pytree
class Trace:
    """What is kept of the stack's info at each step, or T of them stacked along the first axis."""

    path: Array  # [T, 3] weights of (route, micro, ego lane)
    decision: Array  # [T, 7] weights of the outcomes, indexed by Decision
    clearance: Array  # [T, 3] m, planned clearance of (route, micro, ego lane)
    v_target: Array  # [T] m/s, v_T of Eq. 28
    v_ego: Array  # [T] m/s, v_E of Eq. 28
    v_ref: Array  # [T] m/s, reference speed after all caps


def trace(info: Any) -> Any:
    """What figures and tables of a run need of a step; of another driver than the stack all that it says.

    Args: info, of the driver in that step.
    """
    if not isinstance(info, StackInfo):
        return info
    selection, lanes = info.choice.selection, info.speed_plan.lanes
    return Trace(
        path=selection.path,
        decision=selection.decision,
        clearance=info.choice.clearance,
        v_target=lanes.target,
        v_ego=lanes.ego,
        v_ref=info.speed_plan.reference,
    )


def rollout(
    params: LoopParams,
    course: Course,
    lanes: LaneTables,
    start: WorldState,
    n_steps: int,
    keep: Callable[[Any], Any] = trace,
    sensing: Sensing | None = None,
) -> tuple[Log, Any]:
    """Drive `n_steps` steps from `start`; returns the log and what `keep` keeps of the info, stacked over time.

    Pure: jit it with static `n_steps` and `keep`, vmap it over starts and parameters, differentiate it with respect to
    parameters. Raises ScenarioError for a start that is not one run's, not finite or off the road: shapes always,
    values outside jit. Args: course, what the drive is about; lanes, the simulator's tables of its graph
    (`sim.lanes.from_graph`); start, the world; n_steps, steps of the driver; keep, what is kept of the info
    of each step; sensing, for a stack that localizes itself from scans.
    """
    parts = {"course": (course, Course), "lanes": (lanes, LaneTables), "start": (start, WorldState)}
    kinds({"params": (params, LoopParams), **parts}, error=ScenarioError)
    if not callable(keep):
        raise ScenarioError(f"keep is {short(keep)}: give a function of the info of a step (default: rollout.trace)")
    if sensing is not None:
        kind(sensing, "sensing", wanted=Sensing, error=ScenarioError)
    check_start(lanes.graph, course.corridor, world=start)
    check_drive(start, params.vehicle, params=(params.period, params.vehicle, params.stack))
    whole(n_steps, "n_steps", error=ScenarioError, least=1)
    now = begin(params, course, start=start, sensing=sensing)
    _, kept = go_on(params, course, lanes=lanes, now=now, n_steps=n_steps, keep=keep, sensing=sensing)
    return kept


@pytree
class Underway:
    """A closed loop between two steps."""

    state: Any  # of the driver
    world: WorldState


def begin(params: LoopParams, course: Course, *, start: WorldState, sensing: Sensing | None = None) -> Underway:
    """The loop before its first step; see `rollout`.

    Args: course, what the drive is about; start, the world; sensing, for a stack that localizes itself.
    """
    told = start.ego.pose
    if sensing is not None and sensing.told is not None:
        told = jaxlie.SE2.from_xy_theta(sensing.told[0], sensing.told[1], sensing.told[2])
    return Underway(params.handed_down()[0].init(course, told), start)


def go_on(
    params: LoopParams,
    course: Course,
    *,
    lanes: LaneTables,
    now: Underway,
    n_steps: int,
    keep: Callable[[Any], Any] = trace,
    sensing: Sensing | None = None,
) -> tuple[Underway, tuple[Log, Any]]:
    """`n_steps` more of a loop that has begun, for drives that end when they are done; see `rollout`.

    Args: course, what the drive is about; lanes, the simulator's tables; now, the loop so far; n_steps; keep, what is
    kept of each step; sensing, for a stack that localizes itself.
    """
    step = one_step(params, course, lanes=lanes, keep=keep, sensing=sensing)
    # The backward pass recomputes each step from its start, but for what costs much and takes little room: memory grows
    # with the state and with that, not with the plans.
    return jax.lax.scan(recomputed(lambda now, _: step(now)), now, length=n_steps)


def one_step(
    params: LoopParams,
    course: Course,
    *,
    lanes: LaneTables,
    keep: Callable[[Any], Any] = trace,
    sensing: Sensing | None = None,
) -> Callable[[Underway], tuple[Underway, tuple[Log, Any]]]:
    """The loop after one more step, and what is logged and kept of it, as a function of the loop so far.

    Args: course, what the drive is about; lanes, the simulator's tables; keep, what is kept of the step; sensing, for a
    stack that localizes itself.
    """
    driver, sim = params.handed_down()
    course = course.replace(graph=lanes.graph)  # one graph in the program, not two
    relaxation = getattr(driver, "relaxation", HARD)

    def step(so_far: Underway) -> tuple[Underway, tuple[Log, Any]]:
        now = so_far.world
        seen = world.look(sim, lanes, world=now)
        observation = world.observe(sim, lanes, world=now, seen=seen, sensing=sensing)
        command, following, info = driver.step(course, so_far.state, observation)
        entry = log.record(sim, lanes, world=now, command=command, relaxation=relaxation, seen=seen)
        after = world.step(sim, lanes, now, command, params.period, relaxation, seen)
        return Underway(following, after), (entry, keep(info))

    return step
