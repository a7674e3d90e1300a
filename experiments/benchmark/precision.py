"""How often the stack decides differently in single precision than in double, from the same state."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from urbanjax import stack
from urbanjax.course import Course
from urbanjax.rollout import LoopParams
from urbanjax.sim import world as worlds
from urbanjax.sim.lanes import LaneTables
from urbanjax.sim.world import WorldState
from urbanjax.stack import StackInfo
from urbanjax.types import Command, as_arrays, pytree


@pytree
class Decisions:
    """The choices of one step, and the command that came of them."""

    macro: Array  # [S] int, node of each layer
    micro: Array  # [] int, candidate
    path: Array  # [] int, of route, micro and ego lane
    outcome: Array  # [] int, of the decision tree
    command: Command


def decisions(command: Command, info: StackInfo) -> Decisions:
    """The choices of one step."""
    selection = info.choice.selection
    return Decisions(
        macro=jnp.argmax(info.plan.macro.marginal, axis=-1),
        micro=info.plan.micro.chosen,
        path=jnp.argmax(selection.path),
        outcome=jnp.argmax(selection.decision),
        command=command,
    )


def flips(loop: LoopParams, course: Course, lanes: LaneTables, starts: WorldState, n_steps: int) -> dict[str, float]:
    """Share of steps in which float32 chooses otherwise, by choice, and how far commands then differ.

    Closed loops in float64 from S starts (stacked along the first axis) give the states and observations; from each of
    them one step is taken in either precision, so that differences do not build up.
    """
    with jax.enable_x64(True):
        inputs, exact = jax.jit(_drive, static_argnames="n_steps")(
            *as_arrays((loop, course, lanes, starts), np.float64), n_steps=n_steps
        )
        inputs, exact = jax.device_get((inputs, exact))
    single = jax.jit(_again)(*as_arrays((loop, course, inputs), np.float32))
    return compare(exact, jax.device_get(single))


def _drive(
    loop: LoopParams, course: Course, lanes: LaneTables, starts: WorldState, n_steps: int
) -> tuple[Any, Decisions]:
    """State and observation before each step and the decisions in it, [T, S]."""
    params, sim = loop.handed_down()

    def body(carry: tuple, _: None) -> tuple[tuple, tuple]:
        states, now = carry
        observations = jax.vmap(lambda world: worlds.observe(sim, lanes, world=world))(now)
        commands, following, info = jax.vmap(stack.step, in_axes=(None, None, 0, 0))(
            params, course, states, observations
        )
        move = jax.vmap(lambda world, command: worlds.step(sim, lanes, world, command, loop.period))
        return (following, move(now, commands)), ((states, observations), jax.vmap(decisions)(commands, info))

    first = jax.vmap(lambda start: stack.init(params, course, start.ego.pose))(starts)
    _, kept = jax.lax.scan(body, (first, starts), length=n_steps)
    return kept


def _again(loop: LoopParams, course: Course, inputs: Any) -> Decisions:
    """The decisions from given states and observations [T, S]."""
    params, _ = loop.handed_down()

    def one(given: Any) -> Decisions:
        command, _, info = stack.step(params, course, *given)
        return decisions(command, info)

    return jax.lax.map(jax.vmap(one), inputs)


def compare(exact: Decisions, single: Decisions) -> dict[str, float]:
    """Shares of differing choices, and the largest difference of commands with and without one. Args: fields [T, S]."""
    names = ("macro", "micro", "path", "outcome")
    differs = {n: np.asarray(getattr(exact, n)) != np.asarray(getattr(single, n)) for n in names}
    differs["macro"] = differs["macro"].any(-1)
    out = {f"float32_flips_{name}_share": float(which.mean()) for name, which in differs.items()}
    same = ~np.any(list(differs.values()), axis=0)
    for name, unit in (("acceleration", "mps2"), ("steering", "rad")):
        off = np.abs(np.asarray(getattr(exact.command, name)) - np.asarray(getattr(single.command, name)))
        out[f"float32_{name}_error_{unit}"] = float(off[same].max(initial=0))
        out[f"float32_{name}_error_after_a_flip_{unit}"] = float(off[~same].max(initial=0))
    return {"float32_steps_compared": float(same.size), **out}
