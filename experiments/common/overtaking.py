"""The rollouts of Fig. 10 over aggressiveness and start: overtaking on a two-lane road."""

import time
from collections.abc import Callable
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.course import Course, course_between
from urbanjax.evaluation import metrics
from urbanjax.evaluation.metrics import Metrics
from urbanjax.numerics.compiling import compiler_options
from urbanjax.roadmap.corridor import CorridorParams
from urbanjax.rollout import LoopParams, rollout, steps_of
from urbanjax.sim import lanes as tables
from urbanjax.sim.lanes import LaneTables
from urbanjax.sim.log import Log
from urbanjax.sim.scenarios import overtake
from urbanjax.sim.scenarios.overtake import LEADER, RIGHT, OvertakeParams
from urbanjax.sim.scenarios.scenario import Scenario
from urbanjax.sim.world import WorldState
from urbanjax.types import POSITIVE, SEED, SHARE, Unread, as_arrays, field, host_record, pytree, static
from urbanjax.vehicle.params import VehicleParams

NO_CLAMP = 1e-6  # s, a least time to collision that never matters


@pytree
class OvertakeStudy(LoopParams):
    """Which values of tau, how many starts and for how long."""

    UNREAD: ClassVar[dict[str, Unread | None]] = {
        "stack.behavior.gvp.tau": Unread("every value of 'taus' is driven in its place"),
        "sim.traffic.patience": Unread("no lanes cross on this road"),
        "sim.traffic.conflict_range": Unread("no lanes cross on this road"),
    }

    scenario: OvertakeParams = OvertakeParams()
    corridor: CorridorParams = CorridorParams()
    taus: tuple[float, ...] = field(default=(0.0, 0.25, 0.5, 0.75, 1.0), metadata=SHARE)
    duration: float = static(default=20.0, metadata=POSITIVE)  # s
    starts: int = static(default=64)
    seed: int = static(default=0, metadata=SEED)
    gif_every: int = static(default=2, metadata={"range": (0, 1000)})  # steps between the pictures, 0 for none


def scene(study: OvertakeStudy) -> tuple[Course, LaneTables, Scenario]:
    """The course, the simulator's tables of its road, and S starts stacked along the first axis."""
    graph = overtake.road(study.scenario)
    course = course_between(graph, RIGHT, goal=RIGHT, corridor=study.corridor)
    keys = jax.random.split(jax.random.key(study.seed), study.starts)
    scenario, vehicle, others = as_arrays((study.scenario, study.vehicle, study.sim.traffic))
    draw = jax.vmap(lambda key: overtake.sample(key, scenario, vehicle=vehicle, others=others))
    starts = jax.jit(draw)(keys)
    return course, tables.from_graph(graph), starts


def drive(study: OvertakeStudy, tick: Callable[[str], None] = lambda label: None) -> tuple["Fig10", dict[str, float]]:
    """All rollouts of the study, in one compiled program, and the seconds that it took to compile and to run."""
    steps = steps_of(study.duration, study.period)
    course, lanes, starts = scene(study)
    loop = as_arrays(study.loop())
    clamp_time = loop.stack.behavior.gvp.clamp_time
    taus, clamps = as_arrays(jnp.asarray(study.taus)), jnp.stack([clamp_time, jnp.full_like(clamp_time, NO_CLAMP)])
    tick(f"compiling one program for {len(study.taus)} values of tau and {study.starts} starts")
    began = time.perf_counter()
    program = jax.jit(_grid, static_argnames="n_steps", compiler_options=compiler_options())
    program = program.lower(loop, course, lanes, starts.world, taus, clamps, n_steps=steps).compile()
    compiled = time.perf_counter()
    tick(f"driving {2 * len(study.taus) * study.starts} rollouts of {steps} steps")
    log, way, scores = jax.block_until_ready(program(loop, course, lanes, starts.world, taus, clamps))
    times = {"compile_s": compiled - began, "run_s": time.perf_counter() - compiled}
    log, way, scores = jax.device_get((log, way, scores))
    return gather(study.taus, starts.crowded, log, way, scores, study.vehicle), times


def _grid(
    loop: LoopParams,
    course: Course,
    lanes: LaneTables,
    starts: WorldState,
    taus: jax.Array,
    clamps: jax.Array,
    n_steps: int,
) -> tuple[Log, jax.Array, Metrics]:
    """Log, progress and metrics over [A, 2, S]: tau, with and without the clamp, start."""

    def one(tau: jax.Array, clamp_time: jax.Array, start: WorldState) -> tuple[Log, jax.Array, Metrics]:
        gvp = loop.stack.behavior.gvp.replace(tau=tau, clamp_time=clamp_time)
        behavior = loop.stack.behavior.replace(gvp=gvp)
        log, _ = rollout(loop.replace(stack=loop.stack.replace(behavior=behavior)), course, lanes, start, n_steps)
        return log, metrics.progress(log), metrics.evaluate(log, loop.vehicle, relaxation=loop.stack.relaxation)

    shape = taus.size, clamps.size, starts.time.size
    i, k, s = (index.ravel() for index in jnp.indices(shape))
    flat = jax.vmap(one)(taus[i], clamps[k], jax.tree.map(lambda x: x[s], starts))
    return jax.tree.map(lambda x: x.reshape(*shape, *x.shape[1:]), flat)


@host_record
class Fig10:
    """Rollouts over A values of tau, with (0) and without (1) the time-to-collision clamp, and S paired starts."""

    taus: np.ndarray  # [A]
    crowded: np.ndarray  # [S] bool, traffic in the target lane
    time: np.ndarray  # [T] s
    speed: np.ndarray  # [A, 2, S, T] m/s
    way: np.ndarray  # [A, 2, S, T] m, progress since the start
    ego: np.ndarray  # [A, 2, S, T, 3] x, y (m), heading (rad) of the box centre
    others: np.ndarray  # [A, 2, S, T, V, 5] x, y (m), heading (rad), length, width (m)
    present: np.ndarray  # [S, V] bool
    collided: np.ndarray  # [A, 2, S] bool
    completed: np.ndarray  # [A, 2, S] bool, past the slow vehicle at the end
    drop: np.ndarray  # [A, 2, S] m/s, initial less smallest speed
    ttc: np.ndarray  # [A, 2, S] s, smallest time to collision of the boxes
    off_road: np.ndarray  # [A, 2, S] bool
    vehicle: VehicleParams

    @property
    def progress(self) -> np.ndarray:
        """Terminal progress [A, 2, S] m."""
        return self.way[..., -1]


def gather(taus: Any, crowded: Any, log: Log, way: Any, metrics: Metrics, vehicle: VehicleParams) -> Fig10:
    """The study from its rollouts. Args: log, its fields [A, 2, S, T, ..]; way [A, 2, S, T] m; metrics [A, 2, S]."""
    others = log.traffic
    body = np.stack([others.heading, others.length, others.width], axis=-1)
    ego = np.concatenate([log.centre, np.asarray(log.ego.heading)[..., None]], axis=-1)
    others = np.concatenate([others.position, body], axis=-1)
    last = others[:, :, :, -1, LEADER]
    ahead = (ego[:, :, :, -1, :2] - last[..., :2]) * np.stack([np.cos(last[..., 2]), np.sin(last[..., 2])], -1)
    completed = ahead.sum(-1) > (vehicle.length + last[..., 3]) / 2
    return Fig10(
        taus=np.asarray(taus),
        crowded=np.asarray(crowded),
        time=np.asarray(log.time)[0, 0, 0],
        speed=np.asarray(log.ego.speed),
        way=np.asarray(way),
        ego=ego,
        others=others,
        present=np.asarray(log.traffic.valid)[0, 0, :, 0],
        collided=np.asarray(metrics.collision) > 0.5,
        completed=completed,
        drop=np.asarray(metrics.speed_drop),
        ttc=np.asarray(metrics.ttc_box),
        off_road=np.asarray(metrics.off_road) > 0.5,
        vehicle=vehicle,
    )
