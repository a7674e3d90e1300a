"""The closed loop: the stack drives in the simulator, as one scan. Here stack and simulator meet, nowhere else."""

from collections.abc import Callable
from typing import Any

import jax
from jax import Array

from urbanjax import stack
from urbanjax.course import Course
from urbanjax.sim import log, world
from urbanjax.sim.lanes import LaneTables
from urbanjax.sim.log import Log
from urbanjax.sim.world import Sensing, SimParams, WorldState
from urbanjax.stack import StackInfo, StackParams
from urbanjax.types import pytree


@pytree
class LoopParams:
    """Everything that a closed loop depends on."""

    stack: StackParams = StackParams()
    sim: SimParams = SimParams()
    period: float = 0.1  # s, of one stack step


@pytree
class Trace:
    """What is kept of the stack's info at each step, or T of them stacked along the first axis."""

    path: Array  # [T, 3] weights of (route, micro, ego lane)
    decision: Array  # [T, 7] weights of the outcomes, indexed by Decision
    clearance: Array  # [T, 3] m, planned clearance of (route, micro, ego lane)
    v_target: Array  # [T] m/s, v_T of Eq. 28
    v_ego: Array  # [T] m/s, v_E of Eq. 28
    v_ref: Array  # [T] m/s, reference speed after all caps


def trace(info: StackInfo) -> Trace:
    """The part of `info` that figures and tables of a run need."""
    selection, lanes = info.choice.selection, info.speed.lanes
    return Trace(
        path=selection.path,
        decision=selection.decision,
        clearance=info.choice.clearance,
        v_target=lanes.target,
        v_ego=lanes.ego,
        v_ref=info.speed.reference,
    )


def rollout(
    params: LoopParams,
    course: Course,
    lanes: LaneTables,
    start: WorldState,
    n_steps: int,
    keep: Callable[[StackInfo], Any] = trace,
    sensing: Sensing | None = None,
) -> tuple[Log, Any]:
    """Drive `n_steps` stack steps from `start`; returns the log and what `keep` keeps of the info, stacked over time.

    Pure: jit it with static `n_steps` and `keep`, vmap it over starts and parameters, differentiate it with respect to
    parameters. Args: lanes, the simulator's tables of `course.graph` (`sim.lanes.from_graph`); sensing, for a
    stack that localizes itself from scans.
    """
    relaxation = params.stack.relaxation

    def body(carry: tuple, _: None) -> tuple[tuple, tuple]:
        state, now = carry
        observation = world.observe(params.sim, lanes, now, sensing)
        command, following, info = stack.step(params.stack, course, state, observation)
        entry = log.record(params.sim, lanes, now, command, relaxation)
        after = world.step(params.sim, lanes, now, command, params.period, relaxation)
        return (following, after), (entry, keep(info))

    first = stack.init(params.stack, course, start.ego.pose)
    # The backward pass recomputes each step from its start: memory grows with the state alone, not with the plans.
    _, kept = jax.lax.scan(jax.checkpoint(body, prevent_cse=False), (first, start), length=n_steps)
    return kept
