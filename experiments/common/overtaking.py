"""The rollouts of Fig. 10 over aggressiveness and start: overtaking on a two-lane road."""

import itertools
import time
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import jax
import numpy as np

from urbanjax.course import course_between
from urbanjax.evaluation import metrics
from urbanjax.evaluation.batch import CHUNK, Job, Outcome
from urbanjax.evaluation.case import Case
from urbanjax.evaluation.metrics import Metrics
from urbanjax.evaluation.together import Batch, Wanted, together
from urbanjax.numerics.soft import Relaxation
from urbanjax.roadmap.corridor import Corridor, CorridorParams
from urbanjax.rollout import LoopParams, steps_of
from urbanjax.sim import lanes as tables
from urbanjax.sim.agents import TrafficParams
from urbanjax.sim.lanes import LaneTables
from urbanjax.sim.log import Log
from urbanjax.sim.scenarios import overtake
from urbanjax.sim.scenarios.overtake import LEADER, RIGHT, OvertakeParams
from urbanjax.sim.scenarios.scenario import Scenario
from urbanjax.types import POSITIVE, SEED, SHARE, Unread, as_arrays, field, host_record, pytree, static, with_values
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


@host_record
class OvertakeMission:
    """S starts of the scenario as drives: they ask for nothing, and last as long as is said, whatever they pass."""

    corridor: Corridor  # along the right lane
    lanes: LaneTables
    starts: Scenario  # [S]
    longest: float  # s
    name: str = "overtaking"
    size: str = "overtaking"  # one for all

    def case(self, seed: int, *, others: TrafficParams, vehicle: VehicleParams) -> Case:
        """One of the starts, which were drawn for the study's traffic and vehicle. Args: seed, its number."""
        start = jax.tree.map(lambda x: np.asarray(x[seed]), self.starts.world)
        asked: Any = jax.device_get(as_arrays({"goal": np.inf, "limit": self.longest}))
        return Case(self.corridor, self.lanes, start, **asked)


def mission_of(study: OvertakeStudy) -> OvertakeMission:
    """The drives of the study. Raises ConfigError where they have fewer than two steps."""
    steps = steps_of(study.duration, study.period)
    graph = overtake.road(study.scenario)
    course = course_between(graph, RIGHT, goal=RIGHT, corridor=study.corridor)
    keys = jax.random.split(jax.random.key(study.seed), study.starts)
    scenario, vehicle, others = as_arrays((study.scenario, study.vehicle, study.sim.traffic))
    draw = jax.vmap(lambda key: overtake.sample(key, scenario, vehicle=vehicle, others=others))
    parts = jax.device_get((course.corridor, tables.from_graph(graph), jax.jit(draw)(keys)))
    return OvertakeMission(*parts, longest=steps * study.period)


def sets_of(study: OvertakeStudy) -> list[LoopParams]:
    """The closed loops [2 A]: every tau with the study's clamp and without."""
    loop = study.loop()
    clamps = loop.stack.behavior.gvp.clamp_time, NO_CLAMP
    keys = "stack.behavior.gvp.tau", "stack.behavior.gvp.clamp_time"
    return [with_values(loop, dict(zip(keys, values, strict=True))) for values in itertools.product(study.taus, clamps)]


class OvertakeDrives:
    """The drives of the study, and what came of them."""

    def __init__(self, study: OvertakeStudy) -> None:
        """All starts with every parameter set."""
        self.study, self.mission = study, mission_of(study)
        sets = sets_of(study)
        jobs = [Job(self.mission, start, params) for params in range(len(sets)) for start in range(study.starts)]
        chunk = min(CHUNK, len(jobs))
        self.batch = Batch("overtake", tuple(sets), tuple(jobs), chunk=chunk, logs=True, judged=False)
        self.batches = (self.batch,)
        self._logs: dict[str, list[Log]] = {}

    def missing(self) -> dict[str, Batch]:
        """All parts: none is known from before."""
        return dict.fromkeys(self.batch.parts, self.batch)

    def take(self, part: str, outcomes: Sequence[Outcome], later: Callable) -> None:
        """Keep the logs of a part. Args: part; outcomes, of its drives; later, not needed."""
        self._logs[part] = [one.log for one in outcomes if one.log is not None]

    def found(self) -> "Fig10":
        """The study from its drives; their logs are let go."""
        logs = [log for part in self.batch.parts for log in self._logs.pop(part)]
        log = jax.tree.map(lambda *x: np.stack(x), *logs)
        vehicle = self.study.vehicle
        way, scores = jax.device_get(_judged(log, *as_arrays((vehicle, self.study.stack.relaxation))))
        shape = len(self.study.taus), 2, self.study.starts
        log, way, scores = jax.tree.map(lambda x: x.reshape(*shape, *x.shape[1:]), (log, way, scores))
        return gather(self.study.taus, self.mission.starts.crowded, log, way, scores, vehicle)


def drive(study: OvertakeStudy, tick: Callable[[str], None] = lambda label: None) -> tuple["Fig10", dict[str, float]]:
    """All drives of the study, and the seconds that they took with compiling."""
    began = time.perf_counter()
    drives = OvertakeDrives(study)
    jobs, count = len(drives.batch.jobs), 0
    tick(f"{jobs} drives of {drives.mission.longest:g} s")
    for came in together([Wanted("", batch, part) for part, batch in drives.missing().items()]):
        if came.error is not None:
            raise came.error
        drives.take(came.wanted.part, came.outcomes, lambda call: call())
        count += len(came.outcomes)
        tick(f"{count} of {jobs} drives of {drives.mission.longest:g} s")
    return drives.found(), {"run_s": time.perf_counter() - began}


@jax.jit
def _judged(logs: Log, vehicle: VehicleParams, relaxation: Relaxation) -> tuple[jax.Array, Metrics]:
    """Progress and metrics of drives, [N, T] and [N]."""
    return jax.vmap(lambda log: (metrics.progress(log), metrics.evaluate(log, vehicle, relaxation=relaxation)))(logs)


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
