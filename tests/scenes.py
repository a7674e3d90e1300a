"""Small closed-loop scenes shared by tests of the whole: static sizes are cut down so that they compile quickly."""

import math

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.course import Course, course_between
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning.macro import MacroParams
from urbanjax.planning.params import PlanningParams
from urbanjax.planning.prediction import PredictionParams
from urbanjax.planning.primitives import PrimitiveParams
from urbanjax.planning.situation import SituationParams
from urbanjax.roadmap.builders import curve, two_way
from urbanjax.roadmap.builders.specs import RoadStyle
from urbanjax.roadmap.corridor import WindowParams
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.roadmap.padding import GraphSize, pad
from urbanjax.rollout import LoopParams
from urbanjax.sim import lanes as roads
from urbanjax.sim.lanes import LaneTables
from urbanjax.sim.scenarios import overtake
from urbanjax.sim.scenarios.scenario import ego_at, traffic, world
from urbanjax.sim.world import SimParams, WorldState
from urbanjax.stack import StackParams
from urbanjax.types import Objects

# Candidates end between the points of their grid: on a point the gradient is a one-sided one.
SMALL = PlanningParams(
    macro=MacroParams(n_layers=10, nodes_per_lane=3),
    primitives=PrimitiveParams(
        offsets=(-0.5, 0.0, 0.5), durations=(2.0, 3.5), speed_factors=(0.6, 1.0), min_length=8.3, n_points=21
    ),
)


def objects_of(rows, kind=None) -> Objects:
    """Cars from rows of x, y (m), heading (rad) and speed (m/s); kind, a RoadUser of each (None: not said)."""
    x, y, heading, speed = np.array(rows, np.float32).T
    n = len(rows)
    return Objects(
        position=jnp.asarray(np.stack([x, y], axis=-1)),
        heading=jnp.asarray(heading),
        speed=jnp.asarray(speed),
        length=jnp.full(n, 4.7),
        width=jnp.full(n, 1.9),
        valid=jnp.ones(n, bool),
        kind=kind,
    )


def loop_params(mode: str = "hard", temperature: float = 0.1, n_objects: int = 4) -> LoopParams:
    """Parameters of a small closed loop."""
    situation = SituationParams(
        window=WindowParams(behind=30.0, n_stations=160), prediction=PredictionParams(n_times=9, branches=1, hops=1)
    )
    relaxation = Relaxation(mode=mode, temperature=temperature)
    # The pose is given: parameters of the localizer that finds it are none of these programs'.
    stack = StackParams(situation=situation, planning=SMALL, relaxation=relaxation, lidar=None)
    return LoopParams(stack=stack, sim=SimParams(n_objects=n_objects, lane_changes=False))


def overtake_scene(params: LoopParams, n: int, seed: int = 0) -> tuple[Course, LaneTables, WorldState]:
    """Two lanes in one direction; `n` starts of the overtaking family."""
    family = overtake.OvertakeParams(length=400.0)
    graph = overtake.road(family)
    keys = jax.random.split(jax.random.key(seed), n)
    sample = jax.jit(
        jax.vmap(lambda key: overtake.sample(key, family, vehicle=params.vehicle, others=params.sim.traffic).world)
    )
    return course_along(graph, overtake.RIGHT, overtake.RIGHT), roads.from_graph(one_shape(graph)), sample(keys)


def oncoming_scene(params: LoopParams) -> tuple[Course, LaneTables, WorldState]:
    """One lane each way: the ego, off its lane's centre, closes on a slow leader while an oncoming car draws near."""
    graph = two_way(1, 1, length=400.0, style=RoadStyle(lane_width=3.5, speed_limit=14.0))
    vehicles = traffic(
        jnp.array([0, 1, 0, 0], jnp.int32),
        jnp.array([92.0, 190.0, 0.0, 0.0]),
        speed=jnp.array([4.0, 8.0, 0.0, 0.0]),
        limit=14.0,
        params=params.sim.traffic,
        valid=jnp.array([True, True, False, False]),
    )
    ego = ego_at(jnp.asarray(60.0), jnp.asarray(0.15), speed=jnp.asarray(8.97))
    return course_along(graph, 0, 0), roads.from_graph(one_shape(graph)), world(ego, 0, vehicles=vehicles)


def curve_scene(params: LoopParams, aside: float = -2.2) -> tuple[Course, LaneTables, WorldState]:
    """A slow ego before a tight curve; a parked car half on its lane leaves just enough room before a solid line.

    Whether to cross the line, how steeply, and the look-ahead's minimum all matter. Args: aside, the parked car's
    offset from the lane's centre in metres.
    """
    graph = curve(
        30.0, math.pi / 3, n_lanes=2, lead=120.0, transition=10.0, style=RoadStyle(speed_limit=4.2, section=200.0)
    )
    barred = jnp.zeros_like(graph.left_change)
    graph = graph.replace(left_change=barred, right_change=barred)
    vehicles = traffic(
        jnp.array([3, 0, 0, 0], jnp.int32),
        jnp.array([12.0, 105.0, 0.0, 0.0]),
        speed=jnp.array([0.0, 4.0, 0.0, 0.0]),
        limit=4.2,
        params=params.sim.traffic,
        valid=jnp.array([True, True, False, False]),
    )
    beside = jnp.array([aside, 0.0, 0.0, 0.0])
    vehicles = vehicles.replace(offset=beside, offset_from=beside, offset_to=beside)
    ego = ego_at(jnp.asarray(115.0), graph.centre[1, 0, 1] + 0.3, speed=jnp.asarray(3.93))
    return course_along(graph, 1, 5), roads.from_graph(one_shape(graph)), world(ego, 1, vehicles=vehicles)


def course_along(graph: RoadGraph, start: int, goal: int) -> Course:
    """The course from link to link, in the shape that all scenes share."""
    return course_between(one_shape(graph), start, goal=goal)


def one_shape(graph: RoadGraph) -> RoadGraph:
    """The graph in a shape that all scenes share, so that one compiled program serves them."""
    return pad(graph, size=GraphSize(n_links=6)).replace(area_names=("",), area=jnp.zeros(6, jnp.int32))
