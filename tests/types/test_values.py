"""Params with some values changed: checked as a config is, everything else as it was."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import urbanjax
from tests.types.test_config import Whole
from urbanjax import LoopParams
from urbanjax.stack import StackParams
from urbanjax.types import ConfigError, as_arrays
from urbanjax.types.config import to_params

OBSTACLE, TAU = "stack.planning.micro.weights.obstacle", "stack.behavior.gvp.tau"


def test_changes_what_is_named_and_nothing_else():
    params = LoopParams()
    changed = urbanjax.with_values(params, {OBSTACLE: 2.5, TAU: 0.25, "sim.n_objects": 3})
    assert changed.stack.planning.micro.weights.obstacle == 2.5
    assert changed.stack.behavior.gvp.tau == 0.25
    assert changed.sim.n_objects == 3
    back = urbanjax.with_values(changed, {OBSTACLE: 1.0, TAU: 0.75, "sim.n_objects": 16})
    assert back == params


def test_a_partial_group_keeps_the_parents_values_at_every_depth():
    made = to_params(StackParams, {"lidar": {"preprocess": {"downsample": {"capacity": 4096}}}})
    assert made.lidar.preprocess.downsample.resolution == 0.8
    assert made.lidar.preprocess.downsample.capacity == 4096
    made = to_params(StackParams, {"lidar": {"align": {"factor": {"kernel": "none"}}}})
    assert made.lidar.align.factor.max_distance == 3.0
    own = urbanjax.with_values(StackParams(), {"lidar.align.factor.max_distance": 2.0})
    assert urbanjax.with_values(own, {"lidar.align.factor.kernel": "none"}).lidar.align.factor.max_distance == 2.0


def test_arrays_stay_arrays():
    params = as_arrays(LoopParams())
    changed = urbanjax.with_values(params, {OBSTACLE: 2.0, "stack.planning.primitives.durations": [1.0, 2.0]})
    assert jax.tree.map(lambda x: x.dtype, changed.stack.planning.micro) == jax.tree.map(
        lambda x: x.dtype, params.stack.planning.micro
    )
    assert [float(x) for x in changed.stack.planning.primitives.durations] == [1.0, 2.0]
    assert changed.stack.planning.primitives.durations[0].dtype == jnp.float32


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"stack.planning.micro.weights.obstacles": 1.0}, "nearest valid key is"),
        ({TAU: "fast"}, "must be a finite number"),
        ({TAU: float("nan")}, "must be a finite number"),
        ({"stack.localizer": "gps"}, "must be one of"),
        ({"stack.behavior": 1.0}, "is a group of values"),
        ({"sim.n_objects": 2.5}, "must be a whole number"),
        ({TAU: 0.1, "stack.behavior.gvp": {}}, "leave one of them out"),
    ],
)
def test_refuses_what_a_config_refuses(values, message):
    with pytest.raises(ConfigError, match=message):
        urbanjax.with_values(LoopParams(), values)


def test_a_batch_is_zipped_and_maps():
    taus, weights = np.linspace(0, 1, 4), [1.0, 2.0, 3.0, 4.0]
    params, axes = urbanjax.batched_values(as_arrays(LoopParams()), {TAU: taus, OBSTACLE: weights})
    assert axes.stack.behavior.gvp.tau == 0
    assert axes.stack.behavior.gvp.clamp_time is None

    def both(params: LoopParams) -> jax.Array:
        return params.stack.behavior.gvp.tau + params.stack.planning.micro.weights.obstacle + params.period

    np.testing.assert_allclose(jax.vmap(both, in_axes=(axes,))(params), taus + weights + 0.1, rtol=1e-6)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({TAU: [0.1, 0.2], OBSTACLE: [1.0]}, "must have one length"),
        ({TAU: 0.5}, "must be a list of numbers"),
        ({TAU: []}, "must be a list of numbers"),
        ({TAU: [0.1, float("nan")]}, "finite number"),
        ({"sim.n_objects": [1, 2]}, "is no float"),
        ({"stack.taus": [0.1]}, "unknown key"),
        ({}, "no values"),
    ],
)
def test_refuses_batches_that_are_none(values, message):
    with pytest.raises(ConfigError, match=message):
        urbanjax.batched_values(LoopParams(), values)


def test_a_batch_of_what_is_never_zero_maps():
    params, axes = urbanjax.batched_values(as_arrays(LoopParams()), {"period": [0.1, 0.2]})
    assert axes.period == 0
    np.testing.assert_allclose(jax.vmap(lambda p: 2 * p.period, in_axes=(axes,))(params), [0.2, 0.4], rtol=1e-6)


def test_a_group_that_was_none_is_filled_in_as_in_a_config():
    changed = urbanjax.with_values(Whole(), {"sparse.one.shift": 1.0, "sparse.other.shift": 2.0})
    assert changed == to_params(Whole, {"sparse": {"one": {"shift": 1.0}, "other": {"shift": 2.0}}})
    assert changed.sparse.other.gain == 3.0


@pytest.mark.parametrize("value", [np.array(0.5), np.float32(0.5), jnp.float32(0.5)])
def test_a_scalar_array_is_a_number(value):
    assert urbanjax.with_values(LoopParams(), {"stack.behavior.gvp.tau": value}).stack.behavior.gvp.tau == 0.5
