"""The gradient of a closed loop to every continuous parameter of the stack, against central differences."""

import jax
import numpy as np
import pytest

from tests.scenes import curve_scene, loop_params, oncoming_scene, overtake_scene
from urbanjax.evaluation import scores
from urbanjax.rollout import rollout
from urbanjax.types import as_arrays

N_STEPS = 20
STEP = 2e-7  # relative to the size of a parameter, at least 2e-7
AT_ONCE = 2  # directions


def paths_of(tree) -> list[str]:
    return [
        jax.tree_util.keystr(path, simple=True, separator=".") for path, _ in jax.tree_util.tree_leaves_with_path(tree)
    ]


def score_of(stack_params, params, course, lanes, start):
    params = params.replace(stack=stack_params)
    log, _ = rollout(params, course, lanes, start, N_STEPS)
    return scores.score(log, params.vehicle, params=scores.ScoreParams(), relaxation=params.stack.relaxation)


def overtaking(params):
    course, lanes, starts = overtake_scene(params, 1, seed=2)
    return course, lanes, jax.tree.map(lambda x: x[0], starts)


# With their temperatures: lower, the macro plan is decided in the last two; higher, it keeps away from others.
SCENES = ((overtaking, 0.3), (oncoming_scene, 0.6), (curve_scene, 0.6))


class Slopes:
    """Directional derivatives of the score by the parameters as one vector, forward mode and central differences."""

    def __init__(self):
        params = as_arrays(loop_params("soft"))
        self.names = paths_of(params.stack)
        leaves, structure = jax.tree.flatten(params.stack)
        self.point = np.array([float(leaf) for leaf in leaves])
        self.sizes = np.maximum(np.abs(self.point), 1.0)
        self.scenes = [as_arrays(scene(params)) for scene, _ in SCENES]
        warmth = np.array([name == "relaxation.temperature" for name in self.names])
        assert warmth.sum() == 1
        self.points = [np.where(warmth, temperature, self.point) for _, temperature in SCENES]

        def along(vector, course, lanes, start):
            return score_of(jax.tree.unflatten(structure, list(vector)), params, course, lanes, start)

        def forward(vectors, directions, *scene):
            def both(vector, direction):
                return jax.jvp(lambda v: along(v, *scene), (vector,), (direction,))

            return jax.lax.map(lambda each: both(*each), (vectors, directions))

        self._forward = jax.jit(forward)  # also for values alone: one program takes less time than two

    def both(self, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Forward mode and central differences along D directions [D, P], each [scenes, D]."""
        n = len(directions)
        padded = np.concatenate([directions, np.zeros((-n % AT_ONCE, directions.shape[1]))])
        slopes, differences = [], []
        for scene, point in zip(self.scenes, self.points, strict=True):
            for some in padded.reshape(-1, AT_ONCE, padded.shape[1]):
                at = [point + shift * some for shift in (0, STEP, -STEP)]
                (_, slope), (plus, _), (minus, _) = (self._forward(each, some, *scene) for each in at)
                slopes.append(slope)
                differences.append((np.asarray(plus) - np.asarray(minus)) / (2 * STEP))
        shape = len(self.scenes), len(padded)
        return np.reshape(slopes, shape)[:, :n], np.reshape(differences, shape)[:, :n]


@pytest.fixture(scope="module")
def slopes():
    with jax.enable_x64(True):
        yield Slopes()


@pytest.fixture(scope="module")
def differentiated(slopes):
    """Parameter names, the gradient and central differences in each scene; shape [scenes, parameters]."""
    with jax.enable_x64(True):
        gradient, difference = slopes.both(np.diag(slopes.sizes))
    return slopes.names, gradient / slopes.sizes, difference / slopes.sizes


def test_slopes_along_random_directions_match_central_differences(slopes):
    with jax.enable_x64(True):
        draws = np.random.default_rng(0).normal(size=(AT_ONCE, slopes.point.size))
        slope, difference = slopes.both(draws * slopes.sizes / np.sqrt(slopes.point.size))
    assert np.isfinite(slope).all()
    np.testing.assert_allclose(slope, difference, rtol=1e-3, atol=1e-6)


@pytest.mark.slow
def test_gradient_is_finite(differentiated):
    names, gradient, _ = differentiated
    assert np.isfinite(gradient).all(), [n for n, g in zip(names, gradient.T, strict=True) if not np.isfinite(g).all()]


@pytest.mark.slow
def test_gradient_matches_central_differences(differentiated):
    names, gradient, difference = differentiated
    excess = np.max(np.abs(gradient - difference) - 1e-3 * np.abs(difference), axis=0)
    assert excess.max() < 3e-7, sorted(zip(excess, names, strict=True), reverse=True)[:10]  # what rounding leaves


@pytest.mark.slow
def test_the_score_depends_on_what_tuning_would_tune(differentiated):
    names, gradient, _ = differentiated
    strongest = dict(zip(names, np.abs(gradient).max(axis=0), strict=True))
    # Limits among the weights bind on no straight road.
    others = ("tolerance", "scale", "max_curvature", "steering_share")
    wanted = [n for n in names if "weights." in n and not n.endswith(others)]
    wanted += ["behavior.gvp.tau", "behavior.headway.time_headway", "control.lateral.gain", "control.lateral.minimum"]
    silent = [name for name in wanted if not strongest[name] > 1e-9]
    assert not silent, silent


@pytest.mark.slow
def test_reverse_mode_equals_forward_mode(slopes, differentiated):
    _, forward, _ = differentiated
    with jax.enable_x64(True):
        reverse = jax.jit(jax.grad(score_of))
        for scene, (_, temperature), expected in zip(slopes.scenes, SCENES, forward, strict=True):
            params = as_arrays(loop_params("soft", temperature))
            gradient = reverse(params.stack, params, *scene)
            np.testing.assert_allclose(np.array(jax.tree.leaves(gradient)), expected, rtol=1e-6, atol=1e-9)
