"""Weights of the macro lattice from driven paths, by their exact likelihood: one file left out at a time."""

import collections
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from experiments.tune.imitation.task import AT_ONCE, ImitationTask, RecordedDrivers
from urbanjax.evaluation.recorded.demonstration import Demonstration
from urbanjax.numerics.compiling import compiler_options
from urbanjax.rollout import LoopParams
from urbanjax.tuning import GradientDescent, minimise, space
from urbanjax.tuning.losses import lattice
from urbanjax.tuning.losses.lattice import DrivenPath
from urbanjax.types import as_arrays, host_record

PREFIX = "stack.planning.macro.weights."
# Transition is left out, since nothing is remembered of a plan before; clearance, since it moves the nodes themselves;
# line, collision and forbidden are pinned.
LATTICE_WEIGHTS = tuple(
    f"{PREFIX}{name}" for name in ("obstacle", "curvature", "route", "centre", "lane_change", "oncoming")
)
START, RATE, STEPS = 30.0, 0.2, 100  # m; of z a step, so that temperatures from 1 mm to 600 km are within reach
AT_THE_SAME_TIME = 24  # paths whose programme is differentiated at once


@host_record
class PathStudy:
    """The likelihood of N driven paths per layer that was reached, by weights that have not seen their file."""

    use: np.ndarray  # [N] bool: the driven path breaks no limit and reaches a layer
    layers: np.ndarray  # [N] int, reached
    default: np.ndarray  # [N] nat per layer, log-likelihood
    tuned: np.ndarray  # [N] nat per layer
    weights: dict[str, dict[str, float]]  # file left out -> key -> value
    temperature: dict[str, tuple[float, float]]  # file left out -> m, of default and tuned weights
    losses: dict[str, np.ndarray]  # file left out -> [steps] nat per path


def driven_paths(loop: LoopParams, every: Demonstration) -> DrivenPath:
    """What drivers did in the lattice [N, ...], on the host."""
    return jax.device_get(_paths(as_arrays(loop).handed_down()[0], every))


def _each(stack: Any, every: Demonstration) -> DrivenPath:
    def one(demonstration: Demonstration) -> DrivenPath:
        path = lattice.driven_path(demonstration, stack.driving(stack.planning.macro))
        return path.replace(costs=path.costs.replace(lattice=None, room=None, follower=None))

    return jax.lax.map(one, every, batch_size=AT_ONCE)


_paths = jax.jit(_each, compiler_options=compiler_options())


def study_paths(
    task: ImitationTask, loop: LoopParams, drivers: RecordedDrivers, tick: Callable[[str], None]
) -> PathStudy:
    """Tune without each file, and say how likely its paths are."""
    tick("lattices of all moments")
    paths = driven_paths(loop, drivers.every)
    layers = np.asarray(paths.reached).sum(axis=1)
    use = ~np.asarray(paths.barred) & (layers > 0)
    some = jax.tree.map(lambda x: x[use], paths)
    default, tuned = np.full(len(use), np.nan), np.full(len(use), np.nan)
    weights, temperature, losses = {}, {}, {}
    value = losses_of(loop)
    for name in drivers.files:
        tick(f"without {name}: weights of the lattice")
        part, held = drivers.file[use] != name, drivers.file == name
        plain, _ = fit_paths(loop, some, part=part, value=value, fixed=True)
        z, losses[name] = fit_paths(loop, some, part=part, value=value)
        tuned_space = space(loop, LATTICE_WEIGHTS)
        weights[name] = tuned_space.values(jnp.asarray(z[:-1], jnp.float32))
        temperature[name] = (START * float(np.exp(plain[-1])), START * float(np.exp(z[-1])))
        for rows, point in ((default, plain), (tuned, z)):
            said = -np.asarray(value[0](jnp.asarray(point, jnp.float32), some)) / layers[use]
            rows[held & use] = said[held[use]]
    return PathStudy(use, layers, default, tuned, weights, temperature, losses)


def losses_of(loop: LoopParams) -> tuple[Callable, Callable]:
    """-log p [N] of paths at z, and the mean over a part of them with its gradient, each compiled once."""
    tuned, base = space(loop, LATTICE_WEIGHTS), as_arrays(loop)

    def each(z: Array, paths: DrivenPath) -> Array:
        weights = tuned.params(z[:-1], base).stack.planning.macro.weights

        @jax.checkpoint
        def one(path: DrivenPath) -> Array:
            return lattice.driven_path_loss(path, weights, temperature=START * jnp.exp(z[-1]))

        return jax.lax.map(one, paths, batch_size=AT_THE_SAME_TIME)

    def mean(z: Array, paths: DrivenPath, part: Array, prior: Array) -> Array:
        return jnp.sum(each(z, paths) * part) / jnp.sum(part) + prior * jnp.sum(z[:-1] ** 2)

    return jax.jit(each), jax.jit(jax.value_and_grad(mean))


def fit_paths(
    loop: LoopParams,
    paths: DrivenPath,
    *,
    part: np.ndarray,
    value: tuple[Callable, Callable],
    prior: float = 1e-3,
    fixed: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Z [P + 1] of weights and temperature of least loss over a part [N], and the losses [steps]."""
    inputs = jax.device_put((paths, jnp.asarray(part, jnp.float32), jnp.asarray(prior, jnp.float32)))
    count, losses = len(space(loop, LATTICE_WEIGHTS).keys), []

    def evaluate(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        loss, slope = value[1](jnp.asarray(z[0], jnp.float32), *inputs)
        slope = np.asarray(slope, np.float64)
        losses.append(float(loss))
        return np.array(losses[-1:]), np.where(fixed & (np.arange(count + 1) < count), 0.0, slope)[None]

    search = GradientDescent(np.zeros(count + 1), sigma=1.0, seed=0, rate=RATE, steps=STEPS)
    collections.deque(minimise(evaluate, search, budget=STEPS, cost_of_gradient=1.0), maxlen=0)  # to its end
    return search.best.z, np.array(losses)
