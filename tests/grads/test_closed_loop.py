"""The gradient of a closed loop to every continuous parameter of the stack, against central differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.scenes import loop_params, oncoming_scene, overtake_scene
from urbanjax.sim import scores
from urbanjax.sim.rollout import rollout
from urbanjax.types import as_arrays

pytestmark = pytest.mark.slow  # minutes of compiling

N_STEPS = 20
TEMPERATURE = 0.3
STEP = 1e-5  # relative to the parameter's size, at least 1e-5


def paths_of(tree) -> list[str]:
    return [
        jax.tree_util.keystr(path, simple=True, separator=".") for path, _ in jax.tree_util.tree_leaves_with_path(tree)
    ]


def score_of(stack_params, params, course, lanes, start):
    params = params.replace(stack=stack_params)
    log, _ = rollout(params, course, lanes, start, N_STEPS)
    return scores.score(log, params.sim.vehicle, scores.ScoreParams(), params.stack.relaxation)


def overtaking(params):
    course, lanes, starts = overtake_scene(params, 1, seed=2)
    return course, lanes, jax.tree.map(lambda x: x[0], starts)


@pytest.fixture(scope="module")
def differentiated():
    """Parameter names, the gradient and central differences in each scene; shape [scenes, parameters]."""
    with jax.enable_x64(True):
        params = as_arrays(loop_params("soft", TEMPERATURE))
        leaves, structure = jax.tree.flatten(params.stack)
        sizes = np.array([float(leaf) for leaf in leaves])
        steps = STEP * np.maximum(np.abs(sizes), 1.0)

        def along(vector, course, lanes, start):
            stack = jax.tree.unflatten(structure, list(vector))
            return score_of(stack, params, course, lanes, start)

        # Forward mode, and no optimisation: each is compiled once and run a few times, so compiling is what costs.
        quick = {"xla_backend_optimization_level": 0}

        def slopes(vector, *scene):
            def slope(direction):
                return jax.jvp(lambda v: along(v, *scene), (vector,), (direction,))[1]

            return jax.lax.map(slope, jnp.eye(vector.shape[0]))

        def each(vectors, *scene):
            return jax.lax.map(lambda vector: along(vector, *scene), vectors)

        gradient_of = jax.jit(slopes, compiler_options=quick)
        both_sides = jax.jit(each, compiler_options=quick)
        gradients, differences = [], []
        for course, lanes, start in map(as_arrays, (overtaking(params), oncoming_scene(params))):
            gradients.append(np.asarray(gradient_of(jnp.asarray(sizes), course, lanes, start)))
            moved = np.concatenate([sizes + np.diag(steps), sizes - np.diag(steps)])
            values = np.asarray(both_sides(jnp.asarray(moved), course, lanes, start))
            plus, minus = values[: len(sizes)], values[len(sizes) :]
            differences.append((plus - minus) / (2 * steps))
        return paths_of(params.stack), np.array(gradients), np.array(differences)


def test_gradient_is_finite(differentiated):
    names, gradient, _ = differentiated
    assert np.isfinite(gradient).all(), [n for n, g in zip(names, gradient.T, strict=True) if not np.isfinite(g).all()]


def test_gradient_matches_central_differences(differentiated):
    names, gradient, difference = differentiated
    scale = np.maximum(np.abs(difference), 1e-4)
    error = np.max(np.abs(gradient - difference) / scale, axis=0)
    assert error.max() < 1e-3, sorted(zip(error, names, strict=True), reverse=True)[:10]


def test_the_score_depends_on_what_tuning_would_tune(differentiated):
    names, gradient, _ = differentiated
    strongest = dict(zip(names, np.abs(gradient).max(axis=0), strict=True))
    wanted = [n for n in names if "weights." in n and not n.endswith(("tolerance", "scale"))]
    wanted += ["behavior.gvp.tau", "behavior.headway.time_headway", "control.lateral.gain", "control.lateral.minimum"]
    silent = [name for name in wanted if not strongest[name] > 1e-12]
    assert not silent, silent


def test_reverse_mode_equals_forward_mode(differentiated):
    _, forward, _ = differentiated
    with jax.enable_x64(True):
        params = as_arrays(loop_params("soft", TEMPERATURE))
        scene = as_arrays(oncoming_scene(params))
        reverse = jax.jit(jax.grad(score_of), compiler_options={"xla_backend_optimization_level": 0})
        gradient = reverse(params.stack, params, *scene)
        np.testing.assert_allclose(np.array(jax.tree.leaves(gradient)), forward[1], rtol=1e-6, atol=1e-9)
