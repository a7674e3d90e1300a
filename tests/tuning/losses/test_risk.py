"""Conditional value at risk: against sorted means, its bounds, and its gradient."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from urbanjax.tuning.losses.risk import cvar, tail_weights

LOSSES = np.random.default_rng(0).normal(size=(3, 8)).astype(np.float32)


@pytest.mark.parametrize("worst", [1, 2, 5, 8])
def test_a_whole_number_of_the_worst_is_their_mean(worst):
    known = np.sort(LOSSES, axis=-1)[:, -worst:].mean(-1)
    np.testing.assert_allclose(cvar(jnp.asarray(LOSSES), worst / 8), known, rtol=1e-5)


def test_the_last_one_counts_in_part():
    losses = jnp.asarray([0.0, 1.0, 2.0, 3.0])
    assert float(cvar(losses, 0.375)) == pytest.approx((3 + 0.5 * 2) / 1.5)


@settings(deadline=None)  # the first one compiles
@given(st.lists(st.floats(-1e3, 1e3, width=32), min_size=1, max_size=9), st.floats(0.01, 1.0))
def test_weights_are_a_distribution_and_the_value_lies_between_mean_and_worst(losses, share):
    values = jnp.asarray(losses, jnp.float32)
    weights = tail_weights(values, share)
    assert float(weights.sum()) == pytest.approx(1.0, abs=1e-5)
    assert float(weights.min()) >= 0
    slack = 1e-3 + 1e-5 * float(jnp.abs(values).max())
    assert float(values.mean()) - slack <= float(cvar(values, share)) <= float(values.max()) + slack


def test_its_gradient_is_its_weights():
    losses = jnp.asarray(LOSSES[0])
    np.testing.assert_allclose(jax.grad(lambda x: cvar(x, 0.3))(losses), tail_weights(losses, 0.3), atol=1e-6)
