"""Small closed-loop scenes shared by tests of the whole: static sizes are cut down so that they compile quickly."""

import jax
import jax.numpy as jnp

from urbanjax.numerics.soft import Relaxation
from urbanjax.planning.macro import MacroParams
from urbanjax.planning.params import PlanningParams
from urbanjax.planning.prediction import PredictionParams
from urbanjax.planning.primitives import PrimitiveParams
from urbanjax.roadmap.builders import two_way
from urbanjax.roadmap.course import Course, course_between
from urbanjax.roadmap.extended import WindowParams
from urbanjax.sim import lanes as roads
from urbanjax.sim.lanes import Lanes
from urbanjax.sim.rollout import LoopParams
from urbanjax.sim.scenarios import overtake
from urbanjax.sim.scenarios.scenario import ego_at, traffic, world
from urbanjax.sim.world import SimParams, WorldState
from urbanjax.stack import StackParams

SMALL = PlanningParams(
    prediction=PredictionParams(n_times=9, branches=1, hops=1),
    macro=MacroParams(n_layers=10, nodes_per_lane=3),
    primitives=PrimitiveParams(offsets=(-0.5, 0.0, 0.5), durations=(2.0, 3.5), speed_factors=(0.6, 1.0), n_points=21),
)


def loop_params(mode: str = "hard", temperature: float = 0.1, n_objects: int = 4) -> LoopParams:
    """Parameters of a small closed loop."""
    window = WindowParams(behind=30.0, n_stations=160)
    relaxation = Relaxation(mode=mode, temperature=temperature)
    stack = StackParams(planning=SMALL, window=window, relaxation=relaxation)
    return LoopParams(stack=stack, sim=SimParams(n_objects=n_objects, lane_changes=False))


def overtake_scene(params: LoopParams, n: int, seed: int = 0) -> tuple[Course, Lanes, WorldState]:
    """Two lanes in one direction; `n` starts of the overtaking family."""
    family = overtake.OvertakeParams(length=400.0)
    graph = overtake.road(family)
    keys = jax.random.split(jax.random.key(seed), n)
    starts = jax.vmap(lambda key: overtake.sample(key, family, params.sim).world)(keys)
    return course_along(graph, overtake.RIGHT), roads.from_graph(graph), starts


def oncoming_scene(params: LoopParams) -> tuple[Course, Lanes, WorldState]:
    """One lane each way: the ego, off its lane's centre, closes on a slow leader while an oncoming car draws near."""
    graph = two_way(1, 1, 400.0, 3.5, 14.0)
    vehicles = traffic(
        jnp.array([0, 1, 0, 0], jnp.int32),
        jnp.array([92.0, 190.0, 0.0, 0.0]),
        jnp.array([4.0, 8.0, 0.0, 0.0]),
        14.0,
        params.sim.traffic,
        jnp.array([True, True, False, False]),
    )
    ego = ego_at(jnp.asarray(60.0), jnp.asarray(0.15), jnp.asarray(9.0))
    return course_along(graph, 0), roads.from_graph(graph), world(ego, 0, vehicles)


def course_along(graph, link: int) -> Course:
    """The course along one link."""
    return course_between(graph, link, link)
