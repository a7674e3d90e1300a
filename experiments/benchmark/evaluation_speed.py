"""How fast thousands of closed loops are evaluated and in how much memory, beside highway-env on the same machine.

Ours: the stack drives 10 s among 32 vehicles of reactive traffic on the district course, through the programs of
`python -m experiments.evaluate`, judged. highway-env: `highway-v0` with 32 vehicles and its own IDM vehicle as the ego,
10 s, in a Python loop of its road alone: no observation, reward or picture is made. A decision is a step of the driver,
of ours 0.1 s, of highway-env two frames at 15 Hz. Seconds of the processor are told too: they mind less what else the
machine does.
"""

import functools
import importlib.metadata
import itertools
import resource
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from urbanjax.course import Course
from urbanjax.evaluation.batch import CHUNK, Job, outcomes
from urbanjax.evaluation.case import Case
from urbanjax.evaluation.missions.mission import LONGEST
from urbanjax.evaluation.streams import streams
from urbanjax.io.bridges.highway.environment import make_idm, open_environment
from urbanjax.rollout import LoopParams
from urbanjax.sim.agents import TrafficParams
from urbanjax.sim.lanes import LaneTables
from urbanjax.sim.scenarios import circulate
from urbanjax.sim.scenarios.circulate import CirculateParams
from urbanjax.sim.scenarios.stage import StageSize
from urbanjax.types import SEED, host_record, pytree, static
from urbanjax.vehicle.params import VehicleParams

STEPS, PERIOD = 100, 0.1  # of each drive; s
FRAMES, FREQUENCY = 2, 15  # of highway-env in a decision; Hz
WARM = 2  # blocks until all programs are there; a block is a chunk of every stream, which end about together
SETTLED = 10  # chunks, after which memory is not to grow any more
OVER = 50  # chunks, for which growth is told
KB = 1024.0  # in a MB
COMPILED = "/jax/core/compile/backend_compile_duration"  # an event of JAX
LOOP = "jit(segment)"  # the program that drives; one for each size of missions
Tick = Callable[[str], None]


@pytree
class EvaluationSpeedStudy:
    """How many drives, or as many as it takes until all programs are warm, and how many of the peer."""

    drives: int = static(default=64, metadata={"range": (CHUNK * (WARM + 1), 10**6)})
    peer_drives: int = static(default=3, metadata={"range": (1, 1000)})
    seed: int = static(default=0, metadata=SEED)  # the first one


@host_record
class DistrictMission:
    """Ten seconds on the district course: a mission without a goal in reach."""

    course: Course
    lanes: LaneTables
    scenario: CirculateParams
    name: str = "district"
    size: StageSize = StageSize()  # one for all
    longest: float = LONGEST  # s, of logs

    def case(self, seed: int, *, others: TrafficParams, vehicle: VehicleParams) -> Case:
        """The drive of a seed."""
        scenario: Any = self.scenario
        start = _sampler(scenario)(jax.random.key(seed), others, self.lanes)
        end: Any = np.float32((STEPS - 0.5) * PERIOD)
        corridor = self.course.corridor
        return Case(corridor, self.lanes, jax.device_get(start), goal=corridor.length, limit=end)


@functools.cache
def _sampler(scenario: CirculateParams) -> Callable:
    return jax.jit(lambda key, others, lanes: circulate.sample(key, scenario, others=others, lanes=lanes).world)


def measure(
    study: EvaluationSpeedStudy,
    loop: LoopParams,
    course: Course,
    lanes: LaneTables,
    scenario: CirculateParams,
    tick: Tick = lambda label: None,
) -> dict[str, float]:
    """Rates, memory and compiled programs of our drives, and the rate of the peer: name with unit to value."""
    at_once = len(streams())
    block = CHUNK * at_once
    drives = max(study.drives, block * (WARM + 1))
    whole = drives // block
    mission = DistrictMission(jax.device_get(course), jax.device_get(lanes), scenario)
    jobs = [Job(mission, study.seed + k) for k in range(drives)]
    ended, busy, memory, compiled = [time.perf_counter()], [time.process_time()], [_resident_mb()], [0]
    names: list[str] = []  # of the programs that were compiled

    def heard(event: str, duration_secs: float, **kwargs: Any) -> None:
        if event == COMPILED:
            names.append(kwargs.get("fun_name", ""))

    jax.monitoring.register_event_duration_secs_listener(heard)
    try:
        found = outcomes(loop.replace(period=PERIOD), jobs)
        while part := list(itertools.islice(found, block)):
            ended.append(time.perf_counter())
            busy.append(time.process_time())
            memory.append(_resident_mb())
            compiled.append(len(names))
            tick(f"evaluation: {block * (len(ended) - 2) + len(part)} of {drives} drives")
    finally:
        jax.monitoring.unregister_event_duration_listener(heard)
    block_s, cpu_s = (float(np.median(np.diff(times)[WARM:whole])) for times in (ended, busy))
    out = {
        "evaluation_drives": float(drives),
        "evaluation_devices": float(len(jax.local_devices())),
        "evaluation_streams": float(at_once),
        "evaluation_first_block_s": ended[1] - ended[0],
        "evaluation_run_s": ended[-1] - ended[0],
        "evaluation_drives_per_s": block / block_s,
        "evaluation_decisions_per_s": block * STEPS / block_s,
        "evaluation_decisions_per_cpu_s": block * STEPS / cpu_s,
        "evaluation_peak_memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / KB,
        "evaluation_compiles": float(compiled[-1]),
        "evaluation_compiles_of_the_loop": float(names.count(LOOP)),
        "evaluation_compiles_when_warm": float(compiled[-1] - compiled[WARM]),
    }
    if whole * at_once >= SETTLED + OVER:
        out |= growth(memory[SETTLED // at_once : whole + 1], chunks=at_once)
    tick("evaluation: highway-env")
    peer = np.median([_peer(study.seed + k, scenario.n_vehicles) for k in range(study.peer_drives)], axis=0)
    out["highway_env_decisions_per_s"], out["highway_env_decisions_per_cpu_s"] = (1 / peer).tolist()
    out["evaluation_times_highway_env"] = out["evaluation_decisions_per_s"] / out["highway_env_decisions_per_s"]
    return out


def growth(memory: Sequence[float], *, chunks: int) -> dict[str, float]:
    """The trend of memory over `OVER` chunks [MB], Theil and Sen's with its 95 % interval: single values jump by tens.

    Args: memory [MB], after every so many chunks; chunks, how many.
    """
    from scipy.stats import theilslopes

    found = theilslopes(np.asarray(memory, float))
    named = {"": found.slope, "_low": found.low_slope, "_high": found.high_slope}
    return {f"evaluation_memory_growth_mb{name}": float(value) * OVER / chunks for name, value in named.items()}


def _resident_mb() -> float:
    """Memory that this process holds now; the most that it ever held where that is not told."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / KB
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) / KB


def _peer(seed: int, n_vehicles: int) -> tuple[float, float]:
    """Median seconds, and seconds of the processor, of a decision in highway-env; everybody else moves in it too."""
    env = open_environment("highway-v0", duration=STEPS * PERIOD, vehicles_count=n_vehicles)
    env.reset(seed=seed)
    make_idm(env)

    times = [(time.perf_counter(), time.process_time())]
    for _ in range(round(STEPS * PERIOD * FREQUENCY / FRAMES)):
        for _ in range(FRAMES):
            env.road.act()
            env.road.step(1 / FREQUENCY)
        times.append((time.perf_counter(), time.process_time()))
    env.close()
    wall, cpu = np.median(np.diff(times, axis=0), axis=0).tolist()
    return wall, cpu


def table(numbers: dict[str, float]) -> dict[str, list[Any]]:
    """Columns by heading for people."""
    peer = f"highway-env {importlib.metadata.version('highway-env')}, its IDM among 32"
    rows = [
        ("drives of 10 s", round(numbers["evaluation_drives"])),
        ("at the same time", CHUNK * round(numbers["evaluation_streams"])),
        ("these once, cold [s]", numbers["evaluation_first_block_s"]),
        ("drives/s", numbers["evaluation_drives_per_s"]),
        ("ego decisions/s", numbers["evaluation_decisions_per_s"]),
        (f"{peer} [ego decisions/s]", numbers["highway_env_decisions_per_s"]),
        ("times as many", numbers["evaluation_times_highway_env"]),
        ("ego decisions in a second of the processor", numbers["evaluation_decisions_per_cpu_s"]),
        ("the same of highway-env", numbers["highway_env_decisions_per_cpu_s"]),
        ("peak memory [MB]", numbers["evaluation_peak_memory_mb"]),
        ("growth over 50 chunks [MB]", numbers.get("evaluation_memory_growth_mb")),
        ("its 95 % interval, from", numbers.get("evaluation_memory_growth_mb_low")),
        ("to", numbers.get("evaluation_memory_growth_mb_high")),
        ("compiles of the program that drives", round(numbers["evaluation_compiles_of_the_loop"])),
        ("all compiles", round(numbers["evaluation_compiles"])),
        ("of these when warm", round(numbers["evaluation_compiles_when_warm"])),
    ]
    return {"evaluation (medians, warm)": [row[0] for row in rows], "value": [row[1] for row in rows]}
