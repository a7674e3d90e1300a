"""Losses of closed loops row by row: against a rollout of each, and their gradients in both modes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.scenes import loop_params, overtake_scene
from urbanjax.evaluation import scores
from urbanjax.evaluation.case import Case
from urbanjax.numerics.soft import Relaxation
from urbanjax.rollout import begin, rollout
from urbanjax.tuning import space
from urbanjax.tuning.losses.closed_loop import ClosedLoop
from urbanjax.tuning.starts import Start
from urbanjax.types import ConfigError, as_arrays

ROWS, LONGEST = 3, 20
KEYS = ("stack.behavior.gvp.tau", "stack.planning.micro.weights.macro")
SOFT = Relaxation(0.2, "soft")


@pytest.fixture(scope="module")
def base():
    return as_arrays(loop_params())


@pytest.fixture(scope="module")
def scene(base):
    return as_arrays(overtake_scene(base, ROWS, seed=2))


@pytest.fixture(scope="module")
def start(base, scene):
    course, lanes, worlds = scene
    far = jnp.full(ROWS, 1e3)

    def of_all(tree):
        return jax.tree.map(lambda x: np.broadcast_to(np.asarray(x), (ROWS, *np.shape(x))), tree)

    now = jax.jit(jax.vmap(lambda world: begin(base, course, start=world)))(worlds)
    return Start(of_all(base), Case(of_all(course.corridor), of_all(lanes), worlds, far, far), now)


@pytest.fixture(scope="module")
def loop(base):
    return ClosedLoop(space(base, KEYS), LONGEST)


Z = np.array([[0.0, 0.0], [0.5, -0.4], [-0.3, 0.2]], np.float32)


@pytest.fixture(scope="module")
def hard(loop, start):
    return loop.losses(Z, start)


def test_a_row_is_the_score_of_its_rollout(base, scene, loop, start, hard):
    course, lanes, worlds = scene

    @jax.jit
    def score(z, world):
        own = loop.space.params(z, base)
        log, _ = rollout(own, course, lanes, world, LONGEST)
        return scores.score(log, own.vehicle), scores.score(jax.tree.map(lambda x: x[:10], log), own.vehicle)

    whole, half = np.array(
        [score(jnp.asarray(z), jax.tree.map(lambda x, k=k: x[k], worlds)) for k, z in enumerate(Z)]
    ).T
    np.testing.assert_allclose(-hard.loss, whole, rtol=2e-5)
    np.testing.assert_allclose(-loop.losses(Z, start, n_steps=10).loss, half, rtol=2e-5)
    total = sum(np.asarray(getattr(hard.score, name)) for name in vars(hard.score) if name != "total")
    np.testing.assert_allclose(-hard.loss, total, rtol=1e-5)
    assert hard.gradient.shape == (ROWS, 0)


def test_a_row_does_not_depend_on_the_others(loop, start, hard):
    np.testing.assert_array_equal(loop.losses(Z[1:], start.at([1, 2])).loss, hard.loss[1:])


def test_weights_of_a_row_are_its_own(loop, start, hard):
    weights = [scores.ScoreParams(progress=w) for w in (1.0, 2.0, 0.5)]
    found = loop.losses(Z, start, score=weights)
    progress = np.asarray(hard.score.progress)
    np.testing.assert_allclose(found.loss, hard.loss - progress * (np.array([1.0, 2.0, 0.5]) - 1), rtol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("n_steps", [10, 20])
def test_forward_and_reverse_mode_agree(loop, start, n_steps):
    wide = ClosedLoop(loop.space, LONGEST, step_clip=1e6)
    found = [
        wide.losses(Z, start, n_steps=n_steps, relaxation=SOFT, derivative=name) for name in ("forward", "reverse")
    ]
    np.testing.assert_allclose(found[0].loss, found[1].loss, rtol=1e-5)
    np.testing.assert_allclose(found[0].gradient, found[1].gradient, rtol=2e-3, atol=1e-5)


@pytest.mark.slow
def test_the_gradient_is_the_slope_of_the_soft_loss(loop, start):
    found = loop.losses(Z, start, relaxation=SOFT, derivative="auto")
    step = 2e-3
    for k in range(2):
        ahead, behind = (
            loop.losses(
                Z + sign * step * np.eye(2, dtype=np.float32)[k], start, relaxation=SOFT, derivative="auto"
            ).loss
            for sign in (1, -1)
        )
        slope = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(found.gradient[:, k], slope, rtol=0.05, atol=2e-3)
    assert np.abs(found.gradient).max() > 1e-2


@pytest.mark.parametrize("asked", [{"n_steps": 15}, {"n_steps": 30}, {"derivative": "both"}, {"score": []}])
def test_what_there_is_not_is_refused(loop, start, asked):
    with pytest.raises(ConfigError):
        loop.losses(Z, start, **asked)
