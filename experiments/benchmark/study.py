"""How fast stack and simulator run: warm medians, with the cold start stated apart; and what float32 changes."""

import functools
import statistics
import time
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import jax
import jax.numpy as jnp

from experiments.benchmark import divergence_speed, evaluation_speed, plan_speed, precision
from experiments.benchmark.divergence_speed import DivergenceSpeedStudy
from experiments.benchmark.evaluation_speed import EvaluationSpeedStudy
from experiments.benchmark.plan_speed import PlanSpeedStudy
from experiments.candidates import study as candidates
from experiments.candidates.study import CandidateStudy
from experiments.common import registration_speed, timing
from experiments.common.registration_speed import RegistrationStudy
from urbanjax import stack
from urbanjax.course import Course, course_between
from urbanjax.evaluation import metrics
from urbanjax.numerics.compiling import compiler_options
from urbanjax.roadmap.corridor import CorridorParams
from urbanjax.roadmap.costs_to_go import costs_to_go
from urbanjax.roadmap.route import RouteParams
from urbanjax.rollout import LoopParams, rollout
from urbanjax.sim import agents
from urbanjax.sim import lanes as tables
from urbanjax.sim import world as worlds
from urbanjax.sim.lanes import LaneTables
from urbanjax.sim.scenarios import circulate
from urbanjax.sim.scenarios.circulate import CirculateParams
from urbanjax.sim.scenarios.scenario import Scenario
from urbanjax.sim.world import WorldState
from urbanjax.types import SEED, Command, Unread, as_arrays, pytree, static

Tick = Callable[[str], None]
OTHER = ("batches", "scenarios", "sim_steps", "loop_steps", "goals", "repeats", "runs", "precision_steps")
OTHER = (*OTHER, "registration", "plan", "candidates", "divergence")  # what is not read where only the evaluation is


@pytree
class BenchStudy(LoopParams):
    """What is timed, on the district course."""

    UNREAD: ClassVar[dict[str, Unread | None]] = {
        **dict.fromkeys(OTHER, Unread("one part alone is measured, see 'only'", lambda p: p.only)),
    }

    scenario: CirculateParams = CirculateParams()
    corridor: CorridorParams = CorridorParams()
    batches: tuple[int, ...] = static(default=(1, 16, 64))  # sizes of the batches of `stack.step`
    scenarios: int = static(default=64)  # of the simulator's batch
    sim_steps: int = static(default=100)  # policy steps of one simulation
    loop_steps: int = static(default=20)  # steps of one closed loop
    goals: int = static(default=1000)  # to which the cost from every link is found
    repeats: int = static(default=30)  # of each step that is timed
    runs: int = static(default=5)  # of each simulation that is timed
    registration: RegistrationStudy = RegistrationStudy()
    plan: PlanSpeedStudy = PlanSpeedStudy()
    candidates: CandidateStudy = CandidateStudy(sweep=(20,))  # of `few`: no further sizes
    divergence: DivergenceSpeedStudy = DivergenceSpeedStudy()
    evaluation: EvaluationSpeedStudy = EvaluationSpeedStudy()
    only: str = static(default="", metadata={"choices": ("", "evaluation")})  # the one part to be measured; none: all
    precision_steps: int = static(default=50)  # in which float32 is compared with float64, for each scenario
    seed: int = static(default=0, metadata=SEED)


def scene(study: BenchStudy) -> tuple[Course, LaneTables, Scenario]:
    """The district with the ego's route, the simulator's tables, and the starts stacked along the first axis."""
    graph = circulate.road(study.scenario)
    lanes = tables.from_graph(graph)
    scenario, others = as_arrays((study.scenario, study.sim.traffic))
    count = max(study.scenarios, *study.batches)
    keys = jax.random.split(jax.random.key(study.seed), count)
    starts = jax.vmap(lambda key: circulate.sample(key, scenario, others=others, lanes=lanes))(keys)
    start, goal = int(starts.start_link[0]), int(starts.goal_link[0])
    return course_between(graph, start, goal=goal, corridor=study.corridor), lanes, starts


def measure(study: BenchStudy, tick: Tick = lambda label: None) -> dict[str, float]:
    """All numbers of the benchmark: name with unit to value."""
    tick("building the district")
    course, lanes, starts = scene(study)
    loop = as_arrays(study.loop())
    if study.only:
        return evaluation_speed.measure(study.evaluation, loop, course, lanes, study.scenario, tick)
    out = _stack_step(study, loop, course, lanes, starts, tick)
    out.update(_simulator(study, loop, course, lanes, starts, tick))
    tick("one plan")
    out.update(plan_speed.measure(study.plan, loop, course, lanes, jax.tree.map(lambda x: x[0], starts.world)))
    tick("routing")
    out.update(_routing(study, course))
    tick("decisions in float32 and float64")
    batch = jax.tree.map(lambda x: x[: study.scenarios], starts.world)
    out.update(precision.flips(loop, course, lanes, batch, study.precision_steps))
    out.update(candidates.measure(study.candidates, tick))
    out.update(registration_speed.measure(study.registration, tick))
    out.update(evaluation_speed.measure(study.evaluation, loop, course, lanes, study.scenario, tick))
    return out | divergence_speed.measure(study.divergence, tick)


def _stack_step(
    study: BenchStudy, loop: LoopParams, course: Course, lanes: LaneTables, starts: Scenario, tick: Tick
) -> dict[str, float]:
    """Milliseconds per `stack.step`, whole batch, for each size; cold compile time and first step at size 1."""
    out: dict[str, float] = {}
    params, sim = loop.handed_down()
    observe = jax.jit(jax.vmap(lambda world: worlds.observe(sim, lanes, world=world)))
    observations = observe(starts.world)
    poses = observations.pose
    states = jax.jit(jax.vmap(lambda pose: stack.init(params, course, pose)))(poses)
    for size in study.batches:
        tick(f"stack.step, batch of {size}")
        state, observation = jax.tree.map(lambda x, n=size: x[0] if n == 1 else x[:n], (states, observations))
        function = stack.step if size == 1 else jax.vmap(stack.step, in_axes=(None, None, 0, 0))
        step = jax.jit(function, compiler_options=compiler_options())
        first = timing.seconds(step, params, course, state, observation)
        if size == study.batches[0]:
            out["stack_first_step_s"] = first
        samples = []
        for _ in range(study.repeats):
            began = time.perf_counter()
            _, state, _ = jax.block_until_ready(step(params, course, state, observation))
            samples.append(time.perf_counter() - began)
        out[f"stack_step_b{size}_ms"] = 1e3 * statistics.median(samples)
        out[f"stack_step_b{size}_per_vehicle_ms"] = 1e3 * statistics.median(samples) / size
    return out


def _routing(study: BenchStudy, course: Course) -> dict[str, float]:
    """Goals per second to which the least cost from every link of the district is found, all of them at once."""
    search = as_arrays(RouteParams())
    program = jax.jit(lambda graph, goals, search: costs_to_go(graph, goals, params=search))
    goals = jnp.arange(study.goals, dtype=jnp.int32) % len(course.graph.length)
    timing.seconds(program, course.graph, goals, search)
    return {
        "routing_goals_per_s": study.goals / timing.median(program, course.graph, goals, search, runs=study.repeats)
    }


def _simulator(
    study: BenchStudy, loop: LoopParams, course: Course, lanes: LaneTables, starts: Scenario, tick: Tick
) -> dict[str, float]:
    """Vehicle-steps per second of the simulator alone and with the stack; a step is one policy period."""
    batch = jax.tree.map(lambda x: x[: study.scenarios], starts.world)
    vehicles = batch.traffic.valid.shape[1]
    out: dict[str, float] = {}
    for name, function, steps, options in (
        ("simulator", _simulate, study.sim_steps, None),
        ("closed_loop", _close, study.loop_steps, compiler_options()),
    ):
        tick(f"{name}: {study.scenarios} scenarios of {vehicles} vehicles, {steps} steps")
        program = jax.jit(functools.partial(function, n_steps=steps), compiler_options=options)
        out[f"{name}_first_run_s"] = timing.seconds(program, loop, course, lanes, batch)
        seconds = timing.median(program, loop, course, lanes, batch, runs=study.runs)
        out[f"{name}_vehicle_steps_per_s"] = study.scenarios * vehicles * steps / seconds
        out[f"{name}_run_s"] = seconds
    return out


def _simulate(loop: LoopParams, course: Course, lanes: LaneTables, starts: WorldState, n_steps: int) -> Any:
    """Traffic alone, the ego rolling on without a driver; whether any two vehicles ever touched."""
    zero, (_, sim) = jnp.zeros_like(loop.period), loop.handed_down()

    def one(start: WorldState) -> jax.Array:
        def body(carry: tuple, _: None) -> tuple[tuple, None]:
            world, touched = carry
            world = worlds.step(sim, lanes, world, Command(zero, zero), loop.period)
            objects = agents.objects(lanes, world.traffic, params=loop.sim.traffic)
            return (world, touched | jnp.any(metrics.overlaps(objects))), None

        (_, touched), _ = jax.lax.scan(body, (start, jnp.asarray(False)), length=n_steps)
        return touched

    return jax.vmap(one)(starts)


def _close(loop: LoopParams, course: Course, lanes: LaneTables, starts: WorldState, n_steps: int) -> Any:
    """The closed loop, and the metrics of its ego."""

    def one(start: WorldState) -> Any:
        log, _ = rollout(loop, course, lanes, start, n_steps)
        return metrics.evaluate(log, loop.vehicle, relaxation=loop.stack.relaxation)

    return jax.vmap(one)(starts)


def table(numbers: dict[str, float], batches: Sequence[int]) -> dict[str, list[Any]]:
    """Columns by heading for people."""
    rows = [(f"stack.step, {n} at once [ms]", numbers[f"stack_step_b{n}_ms"]) for n in batches]
    rows += [
        ("stack.step, cold: compile and first step [s]", numbers["stack_first_step_s"]),
        (f"one plan of {numbers['plan_candidates']:.0f} candidates [ms]", numbers["plan_ms"]),
        ("the same, 99th percentile [ms]", numbers["plan_p99_ms"]),
        ("simulator alone [vehicle-steps/s]", round(numbers["simulator_vehicle_steps_per_s"])),
        ("simulator with the stack [vehicle-steps/s]", round(numbers["closed_loop_vehicle_steps_per_s"])),
        ("closed loop, cold: compile and first run [s]", numbers["closed_loop_first_run_s"]),
        ("cost to go from every link of the district [goals/s]", round(numbers["routing_goals_per_s"])),
    ]
    rows += [
        (f"float32 chooses another {name} [% of steps]", 100 * numbers[f"float32_flips_{name}_share"])
        for name in ("macro", "micro", "path", "outcome")
    ]
    return {"what (median, warm)": [row[0] for row in rows], "value": [row[1] for row in rows]}
