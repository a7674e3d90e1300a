"""One plan of one moment, explained: the fan coloured by cost, the lattice by its marginals (Fig. 4 and 8)."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax import stack
from urbanjax.io import maps
from urbanjax.io.figures import GOOD, OTHER, figure
from urbanjax.io.lattices import draw_macro
from urbanjax.io.roads import draw_boxes, draw_road
from urbanjax.io.studies.recorded import drive, scenes
from urbanjax.io.studies.situation import look
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning import plan as plans
from urbanjax.planning.plan import Memory, Plan
from urbanjax.roadmap.course import Course, course_between
from urbanjax.roadmap.extended import ExtendedGraph, ExtendParams
from urbanjax.sim import lanes as tables
from urbanjax.sim import world as worlds
from urbanjax.sim.lanes import Lanes
from urbanjax.sim.rollout import LoopParams
from urbanjax.sim.scenarios import overtake
from urbanjax.sim.scenarios.overtake import RIGHT, OvertakeParams
from urbanjax.sim.world import SimParams, WorldState
from urbanjax.stack import StackParams
from urbanjax.types import ConfigError, Observation, Prediction, as_arrays, field, pytree, static

AHEAD, BEHIND, ASIDE = 75.0, 12.0, 10.0  # m shown around the ego
INFEASIBLE = "#c9c9c9"
QUICK = {"xla_backend_optimization_level": 1}


@pytree
class PlanStudy:
    """The moment: some seconds into an overtaking scene, or into a recorded one."""

    stack: StackParams = StackParams()
    sim: SimParams = SimParams()
    scenario: OvertakeParams = OvertakeParams()
    extend: ExtendParams = ExtendParams()
    period: float = 0.1  # s, of one stack step
    time: float = field(default=2.0, metadata={"range": (0.0, 1e3)})  # s driven before
    temperature: float = 2.0  # of the soft plan whose marginals are drawn
    seed: int = static(default=3, metadata={"range": (0, 2**31)})  # of the overtaking scene
    file: str = static(default="", metadata={"path": True})  # a CommonRoad file with recorded traffic, instead
    vehicle: int = static(default=0, metadata={"range": (0, 2**31)})  # who is replaced there; 0: the first


@dataclasses.dataclass(frozen=True)
class Moment:
    """Everything that one plan was made of."""

    course: Course
    window: ExtendedGraph
    observation: Observation
    ego: np.ndarray  # [5] x, y (m) of the box centre, heading (rad), length, width (m)
    prediction: Prediction
    hard: Plan
    soft: Plan


def moment(study: PlanStudy, tick: Callable[[str], None]) -> Moment:
    """Drive up to the moment and plan there, hard and soft."""
    tick("scene")
    loop, course, lanes, world = _scene(study)
    step = jax.jit(stack.step, compiler_options=QUICK)
    observe, advance = jax.jit(worlds.observe), jax.jit(worlds.step)
    state = stack.init(loop.stack, course, world.ego.pose)
    for k in range(round(float(study.time) / float(study.period))):
        tick(f"driving, {k * float(study.period):.1f} s")
        command, state, _ = step(loop.stack, course, state, observe(loop.sim, lanes, world))
        world = advance(loop.sim, lanes, world, command, loop.period)
    tick("planning")
    seen, params = observe(loop.sim, lanes, world), loop.stack
    make = jax.jit(_plan, compiler_options=QUICK)
    modes = (Relaxation(), Relaxation(float(study.temperature), mode="soft"))
    (road, future, hard), (_, _, soft) = (make(params, course, state, seen, world, as_arrays(mode)) for mode in modes)
    vehicle = params.vehicle
    centre = worlds.box_centre(world.ego, vehicle)
    ego = np.array([*centre, world.ego.heading, vehicle.length, vehicle.width], float)
    return Moment(course, road, seen, ego, future, hard, soft)


def _scene(study: PlanStudy) -> tuple[LoopParams, Course, Lanes, WorldState]:
    loop = as_arrays(LoopParams(study.stack, study.sim, study.period))
    if not study.file:
        graph = overtake.road(study.scenario)
        scenario, sim = as_arrays((study.scenario, study.sim))
        start = jax.jit(overtake.sample)(jax.random.key(study.seed), scenario, sim)
        return loop, course_between(graph, RIGHT, RIGHT, extended=study.extend), tables.from_graph(graph), start.world
    road = maps.read(Path(study.file))
    if road.recording is None:
        raise ConfigError(f"{study.file} holds no recorded traffic: choose another 'file'")
    scene = scenes.prepare(road, study.extend, 1.0)
    names, wanted = [start.name for start in scene.starts], str(study.vehicle)
    if study.vehicle and wanted not in names:
        raise ConfigError(f"'vehicle' {wanted} cannot be replaced in {study.file}: use one of {', '.join(names)}")
    k = names.index(wanted) if study.vehicle else 0
    lanes = tables.from_graph(scene.graph)
    extended, world, vehicle = jax.tree.map(
        lambda x: x[k], (scene.extended, drive.worlds_of(loop, scene), scene.vehicle)
    )
    loop = loop.replace(stack=loop.stack.replace(vehicle=vehicle), sim=loop.sim.replace(vehicle=vehicle))
    return loop, Course(scene.graph, extended), lanes, world


def _plan(
    params: StackParams,
    course: Course,
    state: stack.StackState,
    seen: Observation,
    world: WorldState,
    relaxation: Relaxation,
) -> tuple[ExtendedGraph, Prediction, Plan]:
    at = look(params, course, state.station, world.ego, seen.objects)
    memory = Memory(state.macro, state.micro)
    made = plans.plan(
        at.window, at.progress, world.ego, at.prediction, memory, params.vehicle, params.planning, relaxation
    )
    return at.window, at.prediction, made


def seen_from_ego(found: Moment) -> Moment:
    """The same moment in the ego's frame: x ahead and y to the left of its centre."""
    x, y, angle = found.ego[:3]
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    def moved(points: Any) -> Any:
        return jnp.asarray((np.asarray(points, float) - [x, y]) @ turn)

    graph, road, objects = found.course.graph, found.window, found.observation.objects
    hard, path = found.hard, found.hard.micro.path
    return dataclasses.replace(
        found,
        course=found.course.replace(graph=graph.replace(left=moved(graph.left), right=moved(graph.right))),
        window=road.replace(position=moved(road.position), heading=road.heading - angle),
        observation=found.observation.replace(
            objects=objects.replace(position=moved(objects.position), heading=objects.heading - angle)
        ),
        ego=np.array([0.0, 0.0, 0.0, *found.ego[3:]]),
        prediction=found.prediction.replace(position=moved(found.prediction.position)),
        hard=hard.replace(
            fan=hard.fan.replace(position=moved(hard.fan.position)),
            micro=hard.micro.replace(path=path.replace(position=moved(path.position))),
        ),
    )


def draw(moment: Moment, path: Path) -> None:
    """Above the fan by cost, below the macro lattice by the marginals of the soft plan, in the ego's frame."""
    found = seen_from_ego(moment)
    with figure(path, 10.5, 5.6) as canvas:
        upper, lower = canvas.subplots(2, 1)
        for axes in (upper, lower):
            draw_road(axes, found.course.graph)
            _traffic(axes, found)
        bar = _fan(upper, found)
        canvas.colorbar(bar, ax=upper, label="cost above the least [m]", pad=0.01)
        upper.set_title("a  primitives by cost (grey: a limit is broken), the chosen one, predicted traffic")
        bar = draw_macro(lower, found.window, found.soft.macro)
        canvas.colorbar(bar, ax=lower, label="marginal of the node", pad=0.01)
        lower.set_title("b  macro lattice, marginals of the soft plan")
        for axes in (upper, lower):
            axes.set(xlim=(-BEHIND, AHEAD), ylim=(-ASIDE, ASIDE), xlabel="ahead [m]", ylabel="left [m]")


def _traffic(axes: Any, found: Moment) -> None:
    objects, future = found.observation.objects, found.prediction
    there = np.asarray(objects.valid)
    boxes = np.column_stack([objects.position, objects.heading, objects.length, objects.width])[there]
    draw_boxes(axes, boxes, OTHER)
    for way, valid in zip(np.asarray(future.position), np.asarray(future.valid), strict=True):
        if valid:
            axes.plot(*way.T, ".", color=OTHER, ms=2.5, alpha=0.7, zorder=4)
    draw_boxes(axes, found.ego[None], GOOD)


def _fan(axes: Any, found: Moment) -> Any:
    """Candidates as lines, the cheap ones on top."""
    from matplotlib.collections import LineCollection

    micro, lines = found.hard.micro, np.asarray(found.hard.fan.position)
    broken = np.asarray(micro.reasons).any(1)
    paid = np.asarray(micro.terms).sum(1)
    axes.add_collection(LineCollection(list(lines[broken]), colors=INFEASIBLE, linewidths=0.7, zorder=2))
    order = np.argsort(-paid[~broken])
    over = paid[~broken] - paid[~broken].min(initial=np.inf) if (~broken).any() else paid[~broken]
    shown = LineCollection(list(lines[~broken][order]), cmap="plasma_r", linewidths=1.2, zorder=3)
    shown.set_array(over[order])
    axes.add_collection(shown)
    axes.plot(*np.asarray(micro.path.position).T, color=GOOD, lw=2.2, zorder=5)
    return shown
