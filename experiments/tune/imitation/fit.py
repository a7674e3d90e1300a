"""Searches for what makes drivers likely: over weights alone, and through the planner over what the fan depends on."""

from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from experiments.tune.imitation.task import AT_ONCE, N_TIMES, ImitationTask, chosen_from
from urbanjax.evaluation.recorded.demonstration import Demonstration
from urbanjax.numerics.compiling import compiler_options
from urbanjax.rollout import LoopParams
from urbanjax.tuning import GradientDescent, Space, minimise, space
from urbanjax.tuning.losses import imitation
from urbanjax.tuning.losses.imitation import Choices
from urbanjax.types import as_arrays, host_record

PLANNING = "stack.planning."
# Transition is left out: a demonstration has no plan before it, so that nothing informs it.
WEIGHTS = tuple(
    f"{PLANNING}micro.weights.{name}"
    for name in ("obstacle", "curvature", "curvature_rate", "macro", "slowness", "lateral_acceleration", "acceleration")
)
# What else decides how fast candidates are, and what they keep clear of. Durations are left as they are: a displacement
# after 3 s is least where they are longer than any manoeuvre, which no vehicle should be driven with.
FAN = (
    f"{PLANNING}primitives.speed_factors",
    f"{PLANNING}macro.profile.acceleration",
    f"{PLANNING}macro.profile.deceleration",
    f"{PLANNING}macro.lateral_acceleration",
    f"{PLANNING}micro.min_clearance",
)
START = 10.0  # m, the temperature that searches start from: no choice is clear there
RATE, FAN_RATE = 0.05, 0.1  # of z a step
KEPT_EVERY = 12  # steps of a search through the planner, of which the best on the training files is kept
BESIDE = (-0.7, 0.0, 0.7)  # m, offsets of the fan while it is tuned through the planner: a third of the time
COST_OF_GRADIENT = 1.0  # budgets count steps


@host_record
class Fitted:
    """What a search came to."""

    space: Space
    z: np.ndarray  # [P]
    temperature: float  # m
    losses: np.ndarray  # [steps] nat, of the training set or of a part of it

    def params(self, base: LoopParams) -> LoopParams:
        """The tuned loop. Args: base, from which the search began."""
        return self.space.params(jnp.asarray(self.z, jnp.float32), as_arrays(base))


def fit_temperature(
    task: ImitationTask, loop: LoopParams, choices: Choices, *, part: np.ndarray, loss: str = "nearest"
) -> float:
    """The temperature [m] under which some weights as they are suit a part [N] of the demonstrations best."""
    return fit_weights(task, loop, choices, part=part, loss=loss, fixed=True).temperature


def fit_weights(
    task: ImitationTask,
    loop: LoopParams,
    choices: Choices,
    *,
    part: np.ndarray,
    start: float = START,
    loss: str = "nearest",
    fixed: bool = False,
) -> Fitted:
    """Weights and temperature of least loss over a part [N] of the demonstrations, whose fan stays as it is."""
    tuned, base = space(loop, WEIGHTS), as_arrays(loop)
    of_choice = LOSSES[loss]

    def value(z: Array, choices: Choices, part: Array, base: LoopParams) -> Array:
        moved = tuned.params(0 * z[:-1] if fixed else z[:-1], base).stack.planning.micro.weights
        each = jax.vmap(lambda one: of_choice(one, moved, start * jnp.exp(z[-1]), task.spread))(choices)
        return jnp.sum(each * part) / jnp.sum(part) + task.prior * jnp.sum(z[:-1] ** 2)

    slope = jax.jit(jax.value_and_grad(value))
    inputs = jax.device_put((choices, as_arrays(jnp.asarray(part, float)), base))
    search = GradientDescent(np.zeros(len(tuned.keys) + 1), sigma=1.0, seed=0, rate=RATE, steps=task.steps)
    losses = list(_descend(lambda z: slope(z, *inputs), search, task.steps))
    return Fitted(tuned, search.best.z[:-1], start * float(np.exp(search.best.z[-1])), np.array(losses))


def fit_fan(
    task: ImitationTask, loop: LoopParams, every: Demonstration, *, part: np.ndarray, slope: Any = None
) -> Fitted:
    """Weights and what the fan depends on, by the gradient through the planner, over batches of a part [N].

    Of the points every KEPT_EVERY steps the one of least expected displacement over the whole part is kept: as the
    temperature falls, a batch may throw the search off.
    """
    slope = slope or through_planner(task, loop)
    tuned, base = space(loop, (*WEIGHTS, *FAN)), as_arrays(loop)
    rng, members = np.random.default_rng(task.seed), np.flatnonzero(part)

    def evaluate(z: Array) -> tuple[Array, Array]:
        rows = rng.choice(members, task.batch, replace=len(members) < task.batch)
        return slope(z, jax.tree.map(lambda x: x[rows], every), base)

    start = np.zeros(len(tuned.keys) + 1)
    search = GradientDescent(start, sigma=1.0, seed=0, rate=FAN_RATE, steps=task.fan_steps)
    losses, points = [], []
    for loss in _descend(evaluate, search, task.fan_steps):
        losses.append(loss)
        if len(losses) % KEPT_EVERY == 0 or len(losses) == task.fan_steps:
            points.append(search.standing()[0])
    found = [Fitted(tuned, z[:-1], START * float(np.exp(z[-1])), np.array(losses)) for z in points]
    return min(found, key=lambda one: _expected(task, one, loop, every=every, part=part))


def _expected(task: ImitationTask, one: Fitted, loop: LoopParams, *, every: Demonstration, part: np.ndarray) -> float:
    """Expected final displacement [m] over a part [N], by the whole fan."""
    moved = one.params(loop)
    weights = moved.stack.planning.micro.weights
    return float(_mean_displaced(chosen_from(moved, every), weights, one.temperature, jnp.asarray(part, float)))


def through_planner(task: ImitationTask, loop: LoopParams) -> Callable[..., tuple[Array, Array]]:
    """Loss and gradient by (z, demonstrations, base), compiled once for all parts."""
    tuned = space(loop, (*WEIGHTS, *FAN))

    def value(z: Array, every: Demonstration, base: LoopParams) -> Array:
        stack = tuned.params(z[:-1], base).handed_down()[0]
        planning = stack.planning.replace(primitives=stack.planning.primitives.replace(offsets=BESIDE))

        @jax.checkpoint
        def one(demonstration: Demonstration) -> Array:
            choices = imitation.choices(demonstration, stack.driving(planning), n_times=N_TIMES)
            weights = planning.micro.weights
            return displaced(choices, weights, START * jnp.exp(z[-1]), task.spread)

        return jnp.mean(jax.lax.map(one, every, batch_size=AT_ONCE)) + task.prior * jnp.sum(z[:-1] ** 2)

    return jax.jit(jax.value_and_grad(value), compiler_options=compiler_options())


def nearest(choices: Choices, weights: Any, temperature: Array | float, spread: Array | float) -> Array:
    """-log P of the candidate nearest to one driver [nat]."""
    return imitation.nearest_loss(choices, imitation.costs(choices, weights), temperature=temperature)


def driven(choices: Choices, weights: Any, temperature: Array | float, spread: Array | float) -> Array:
    """-log density of what one driver did [nat]."""
    cost = imitation.costs(choices, weights)
    return imitation.driven_loss(choices, cost, temperature=temperature, spread=spread)


def displaced(choices: Choices, weights: Any, temperature: Array | float, spread: Array | float) -> Array:
    """Expected final displacement from one driver [m]."""
    return imitation.displacement(choices, imitation.costs(choices, weights), temperature=temperature)


@jax.jit
def _mean_displaced(choices: Choices, weights: Any, temperature: Array, part: Array) -> Array:
    each = jax.vmap(lambda one: displaced(one, weights, temperature, 1.0))(choices)
    return jnp.sum(each * part) / jnp.sum(part)


LOSSES = {"nearest": nearest, "driven": driven, "displaced": displaced}


def _descend(evaluate: Callable[[Array], Any], search: GradientDescent, steps: int) -> Iterator[float]:
    """The loss of each step."""
    last = []

    def one(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        loss, gradient = evaluate(jnp.asarray(z[0], jnp.float32))
        last[:] = [float(loss)]
        return np.array(last), np.asarray(gradient, np.float64)[None]

    for _ in minimise(one, search, budget=steps, cost_of_gradient=COST_OF_GRADIENT):
        yield last[0]
