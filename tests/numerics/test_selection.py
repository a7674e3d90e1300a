"""The k smallest are numpy's; tags come out as they went in."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.numerics import selection


@pytest.mark.parametrize(("k", "c"), [(1, 1), (1, 33), (5, 3), (7, 100), (10, 96), (16, 16), (25, 128), (33, 40)])
def test_smallest_equal_numpy(k, c):
    keys = np.random.default_rng(c).normal(size=(4, 3, c)).astype(np.float32)
    keys[0, 0, :] = 1.0
    keys[1, 1, c // 2 :] = np.inf
    found = np.stack(jax.jit(selection.smallest, static_argnums=1)(keys, k), axis=-1)
    expected = np.sort(np.pad(keys, ((0, 0), (0, 0), (0, k)), constant_values=np.inf), axis=-1)[..., :k]
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_tags_survive_and_order_is_that_of_the_values(dtype, x64):
    rng = np.random.default_rng(0)
    values = (rng.uniform(0, 1, 500) ** 8 * 1e4).astype(dtype)
    values[:3] = 0, np.inf, np.finfo(dtype).max
    tags = rng.integers(0, 128, 500).astype(np.int32)
    keys = jax.jit(selection.tagged, static_argnames="bits")(jnp.asarray(values), jnp.asarray(tags), bits=7)
    found, back = (np.asarray(x) for x in jax.jit(selection.untagged, static_argnums=1)(keys, 7))
    np.testing.assert_array_equal(back, tags)
    assert keys.dtype == found.dtype == dtype
    assert np.isinf(found[1:3]).all()
    others = np.delete(np.arange(500), [1, 2])
    np.testing.assert_allclose(found[others], values[others], rtol=2e-5, atol=1e-30)
    assert np.all(found[others] <= np.maximum(values[others], 1e-30))
    assert np.all(np.diff(np.asarray(keys)[np.argsort(values, kind="stable")][:-2]) >= 0) or dtype == np.float32
