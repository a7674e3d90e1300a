"""Nothing is promoted on the way: a step mixes no integers, truth values or precisions that it was not told to mix."""

import jax
import jax.numpy as jnp
import jaxlie
import pytest

from tests.registration.conftest import MAP
from tests.scenes import loop_params, overtake_scene
from urbanjax import evaluation, registration, traffic
from urbanjax.registration import PreprocessParams
from urbanjax.registration.downsample import DownsampleParams
from urbanjax.rollout import rollout
from urbanjax.traffic.divergence.estimate import DivergenceParams, divergence
from urbanjax.traffic.safety.measure import measure
from urbanjax.types import Objects, as_arrays


@pytest.fixture(autouse=True)
def strict():
    with jax.numpy_dtype_promotion("strict"):
        yield


def test_the_closed_loop_and_its_metrics():
    """In the mode that holds both the hard choices and the soft ones."""
    params = as_arrays(loop_params("straight_through"))
    with jax.numpy_dtype_promotion("standard"):  # of what is made before the loop
        course, lanes, starts = overtake_scene(params, 1)
    start = jax.tree.map(lambda x: x[0], starts)

    def score(params):
        log, _ = rollout(params, course, lanes, start, 2)
        relaxation = params.stack.relaxation
        found = evaluation.evaluate(log, params.vehicle, relaxation=relaxation)
        return evaluation.score(log, params.vehicle, relaxation=relaxation), found

    assert jax.eval_shape(score, params)[0].dtype == jnp.float32


def test_registration_and_localization():
    points, valid = jnp.ones((500, 3)), jnp.ones(500, bool)
    how = as_arrays(registration.AlignParams())
    params = as_arrays(PreprocessParams(downsample=DownsampleParams(resolution=0.5, capacity=256)))

    def pose(points):
        cloud, _ = registration.preprocess(points, valid, params=params)
        world = registration.build(cloud, as_arrays(MAP))
        return registration.align(cloud, world, start=jaxlie.SE3.identity(), params=how)

    assert jax.eval_shape(pose, points).covariance.dtype == jnp.float32


def test_traffic():
    points, valid = jnp.ones((2, 50, 2)), jnp.ones((2, 50), bool)
    found = jax.eval_shape(lambda p: divergence(p, valid, params=as_arrays(DivergenceParams())), points)
    assert found.value.dtype == jnp.float32
    rows = jnp.ones((6, 3))
    tracks = Objects(jnp.ones((6, 3, 2)), rows, rows, rows, rows, jnp.ones((6, 3), bool))
    safety = jax.eval_shape(lambda t: measure(t, jnp.asarray(0.1), params=as_arrays(traffic.SafetyParams())), tracks)
    assert safety.summary.tit.dtype == jnp.float32
