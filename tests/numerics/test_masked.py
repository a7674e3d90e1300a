"""Masked statistics equal numpy's of the entries that count, whatever the others hold."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.numerics import masked

RNG = np.random.default_rng(0)
X = RNG.normal(size=(3, 12)).astype(np.float32)
MASK = RNG.random((3, 12)) < 0.6
HOLES = np.where(MASK, X, np.nan)


@pytest.mark.parametrize(
    ("ours", "numpys"),
    [
        (masked.mean, np.nanmean),
        (masked.std, np.nanstd),
        (masked.largest, np.nanmax),
        (masked.rms, lambda x, axis: np.sqrt(np.nanmean(x**2, axis=axis))),
        (lambda x, m: masked.quantile(x, m, level=0.3), lambda x, axis: np.nanquantile(x, 0.3, axis=axis)),
        (lambda x, m: masked.quantile(x, m, level=1.0), np.nanmax),
    ],
)
def test_statistics_of_the_entries_that_count(ours, numpys):
    np.testing.assert_allclose(jax.jit(ours)(HOLES, MASK), numpys(HOLES, axis=1), rtol=1e-5)


@pytest.mark.parametrize(
    "statistic", [masked.mean, masked.std, masked.rms, masked.largest, lambda x, m: masked.quantile(x, m, level=0.5)]
)
def test_nothing_to_count_is_zero_with_derivative_zero(statistic):
    value, slope = jax.jit(jax.value_and_grad(statistic))(jnp.full(5, jnp.nan), jnp.zeros(5, bool))
    assert value == 0
    np.testing.assert_array_equal(slope, 0)
    _, slope = jax.jit(jax.value_and_grad(statistic))(jnp.ones(5), jnp.ones(5, bool))
    assert np.isfinite(slope).all()


def test_latest_is_the_last_entry_that_counts():
    mask = jnp.array([[0, 0, 1, 0, 0, 1, 0], [0, 0, 0, 0, 0, 0, 0]], bool)
    np.testing.assert_array_equal(masked.latest(mask), [[2, 2, 2, 2, 2, 5, 5], [0] * 7])
