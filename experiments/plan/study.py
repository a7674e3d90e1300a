"""One plan of one moment: what it was made of, hard and soft."""

from collections.abc import Callable
from pathlib import Path
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax import stack
from urbanjax.course import Course, course_between
from urbanjax.evaluation.missions.recorded import recorded_mission
from urbanjax.evaluation.recorded import scenes
from urbanjax.io import maps
from urbanjax.numerics.compiling import compiler_options
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning import plan as plans
from urbanjax.planning.plan import Plan
from urbanjax.planning.situation import Situation, look
from urbanjax.roadmap.corridor import Corridor, CorridorParams
from urbanjax.rollout import LoopParams
from urbanjax.sim import lanes as tables
from urbanjax.sim import world as worlds
from urbanjax.sim.lanes import LaneTables
from urbanjax.sim.scenarios import overtake
from urbanjax.sim.scenarios.overtake import RIGHT, OvertakeParams
from urbanjax.sim.world import WorldState
from urbanjax.stack import StackParams
from urbanjax.types import (
    POSITIVE,
    SEED,
    ConfigError,
    Observation,
    Prediction,
    Unread,
    as_arrays,
    field,
    host_record,
    pytree,
    static,
)

# What a recorded scene has of its own, or no use for.
MADE_UP = ("scenario", "seed", "vehicle", "sim.traffic", "sim.reaction", "sim.lane_changes")


@pytree
class PlanStudy(LoopParams):
    """The moment: some seconds into an overtaking scene, or into a recorded one."""

    UNREAD: ClassVar[dict[str, Unread | None]] = {
        "stack.planning.*_scale": None,
        "ego": Unread("only a recording has somebody to be replaced, see 'file'", lambda p: not p.file),
        **dict.fromkeys(MADE_UP, Unread("the scene is a recording, see 'file'", lambda p: bool(p.file))),
    }

    scenario: OvertakeParams = OvertakeParams()
    corridor: CorridorParams = CorridorParams()
    time: float = field(default=2.0, metadata={"range": (0.0, 1e3)})  # s driven before
    temperature: float = field(default=2.0, metadata=POSITIVE)  # of the soft plan whose marginals are drawn
    seed: int = static(default=3, metadata=SEED)  # of the overtaking scene
    file: str = static(default="", metadata={"path": True})  # a CommonRoad file with recorded traffic, instead
    ego: int = static(default=0, metadata={"range": (0, 2**31)})  # who is replaced there; 0: the first


@host_record
class Moment:
    """Everything that one plan was made of."""

    course: Course
    window: Corridor
    observation: Observation
    ego: np.ndarray  # [5] x, y (m) of the box centre, heading (rad), length, width (m)
    prediction: Prediction
    hard: Plan
    soft: Plan


def moment(study: PlanStudy, tick: Callable[[str], None]) -> Moment:
    """Drive up to the moment and plan there, hard and soft."""
    tick("scene")
    loop, course, lanes, world = _scene(study)
    params, sim = loop.handed_down()
    step = jax.jit(stack.step, compiler_options=compiler_options())
    observe, advance = jax.jit(lambda world: worlds.observe(sim, lanes, world=world)), jax.jit(worlds.step)
    state = stack.init(params, course, world.ego.pose)
    for k in range(round(float(study.time) / float(study.period))):
        tick(f"driving, {k * float(study.period):.1f} s")
        command, state, _ = step(params, course, state, observe(world))
        world = advance(sim, lanes, world, command, loop.period)
    tick("planning")
    seen = observe(world)
    make = jax.jit(_plan, compiler_options=compiler_options())
    modes = (Relaxation(), Relaxation(float(study.temperature), mode="soft"))
    modes = [params.replace(relaxation=as_arrays(mode)) for mode in modes]
    (at, hard), (_, soft) = (make(mode, course, state, seen, world) for mode in modes)
    vehicle = params.vehicle
    centre = worlds.box_centre(world.ego, vehicle)
    ego = np.array([*centre, world.ego.heading, vehicle.length, vehicle.width], float)
    return Moment(course, at.window, seen, ego, at.prediction, hard, soft)


def _scene(study: PlanStudy) -> tuple[LoopParams, Course, LaneTables, WorldState]:
    loop = as_arrays(study.loop())
    if not study.file:
        graph = overtake.road(study.scenario)
        scenario = as_arrays(study.scenario)
        draw = jax.jit(lambda key: overtake.sample(key, scenario, vehicle=loop.vehicle, others=loop.sim.traffic))
        start = draw(jax.random.key(study.seed))
        course = course_between(graph, RIGHT, goal=RIGHT, corridor=study.corridor)
        return loop, course, tables.from_graph(graph), start.world
    road = maps.read(Path(study.file))
    if road.recording is None:
        raise ConfigError(f"{study.file} holds no recorded traffic: choose another 'file'")
    scene = scenes.prepare(
        road.path.stem,
        road.graph,
        recording=road.recording,
        params=study.corridor,
        shortest=1.0,
        cycles=road.cycles,
    )
    names, wanted = [start.name for start in scene.starts], str(study.ego)
    if study.ego and wanted not in names:
        raise ConfigError(f"'ego' {wanted} cannot be replaced in {study.file}: use one of {', '.join(names)}")
    k = names.index(wanted) if study.ego else 0
    case = recorded_mission(scene, endless=True).case(k, others=loop.sim.traffic, vehicle=loop.vehicle)
    case = jax.tree.map(jnp.asarray, case)
    return loop.replace(vehicle=case.vehicle), case.course, case.lanes, case.start


def _plan(
    params: StackParams, course: Course, state: stack.StackState, seen: Observation, world: WorldState
) -> tuple[Situation, Plan]:
    at = look(params.situation, course, station=state.station, ego=world.ego, observation=seen)
    return at, plans.plan(at, params.driving(params.planning), memory=state.plan)
