"""How long one motion plan takes: macro plan, fan and choice, among as many objects as the stack looks at."""

import statistics
import time

import jax
import jax.numpy as jnp
import numpy as np

from experiments.common import timing
from urbanjax.course import Course
from urbanjax.numerics.compiling import compiler_options
from urbanjax.planning import plan as plans
from urbanjax.planning.primitives import PrimitiveParams
from urbanjax.planning.situation import look
from urbanjax.roadmap.progress import progress
from urbanjax.rollout import LoopParams
from urbanjax.sim import world as worlds
from urbanjax.sim.lanes import LaneTables
from urbanjax.sim.world import WorldState
from urbanjax.types import as_arrays, pytree, static


@pytree
class PlanSpeedStudy:
    """512 candidates: 8 offsets x 8 speeds x 8 durations."""

    fan: PrimitiveParams = PrimitiveParams(
        offsets=tuple(np.linspace(-1.4, 1.4, 8).round(2).tolist()),
        speed_factors=tuple(np.linspace(0.3, 1.0, 8).round(2).tolist()),
        durations=tuple(np.linspace(1.5, 5.0, 8).tolist()),
    )
    repeats: int = static(default=300)


def measure(
    study: PlanSpeedStudy, loop: LoopParams, course: Course, lanes: LaneTables, world: WorldState
) -> dict[str, float]:
    """Milliseconds of one plan, by name: median, 99th percentile, and seconds of the first call."""
    stack, sim = loop.handed_down()
    planning = as_arrays(stack.planning.replace(primitives=study.fan))
    driving = stack.driving(planning)
    seen = worlds.observe(sim, lanes, world=world)
    station = progress(course.corridor, world.ego.position, heading=world.ego.heading).station
    at = look(stack.situation, course, station=station, ego=world.ego, observation=seen)
    memory = as_arrays(plans.nothing(planning))
    program = jax.jit(
        lambda at, driving, memory: plans.plan(at, driving, memory=memory), compiler_options=compiler_options()
    )
    first = timing.seconds(program, at, driving, memory)
    made, samples = program(at, driving, memory), []
    for _ in range(study.repeats):
        began = time.perf_counter()
        jax.block_until_ready(program(at, driving, memory))
        samples.append(1e3 * (time.perf_counter() - began))
    return {
        "plan_ms": statistics.median(samples),
        "plan_p99_ms": float(np.percentile(samples, 99)),
        "plan_first_s": first,
        "plan_candidates": float(made.micro.cost.shape[0]),
        "plan_objects": float(jnp.sum(seen.objects.valid)),
        "plan_predicted_boxes": float(at.prediction.valid.shape[0]),
    }
