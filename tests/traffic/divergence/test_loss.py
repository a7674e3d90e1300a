"""The maximum mean discrepancy: its definition, its sign, its gradient."""

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.traffic.divergence.loss import squared_mmd


def definition(x, y, scales):
    """By full kernel matrices in float64."""

    def kernel(a, b):
        squared = ((a[:, None] - b[None]) ** 2).sum(-1)
        return np.mean([np.exp(-squared / (2 * s**2)) for s in scales], axis=0)

    n, m = len(x), len(y)
    within = (kernel(x, x).sum() - n) / (n * (n - 1)) + (kernel(y, y).sum() - m) / (m * (m - 1))
    return within - 2 * kernel(x, y).mean()


def test_equals_its_definition_with_masks():
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(300, 2)).astype(np.float32), 1 + rng.normal(size=(270, 2)).astype(np.float32)
    valid_x, valid_y = np.arange(300) < 260, np.arange(270) < 270
    scales = (0.5, 2.0, 8.0)
    found = jax.jit(squared_mmd)(jnp.where(valid_x[:, None], x, jnp.nan), y, valid_x=valid_x, valid_y=valid_y)
    np.testing.assert_allclose(found, definition(x[:260].astype(float), y.astype(float), scales), atol=1e-5)


def test_is_near_zero_for_one_distribution_and_grows_with_the_shift():
    rng = np.random.default_rng(1)
    every = np.ones(400, bool)
    values = [
        float(
            jax.jit(squared_mmd)(
                rng.normal(size=(400, 2)),
                rng.normal(size=(400, 2)) + np.array([shift, 0]),
                valid_x=every,
                valid_y=every,
            )
        )
        for shift in (0.0, 0.5, 1.0, 2.0)
    ]
    assert abs(values[0]) < 0.005
    assert np.all(np.diff(values) > 0)


def test_gradients_equal_central_differences(x64):
    rng = np.random.default_rng(2)
    x, y = rng.normal(size=(2, 30, 2))
    x[1] = x[0]  # coincident
    every = jnp.ones(30, bool)

    def value(x):
        return squared_mmd(x, jnp.asarray(y), valid_x=every, valid_y=every)

    slope, step = jax.grad(value)(jnp.asarray(x)), 1e-6
    direction = rng.normal(size=x.shape)
    ahead, behind = (float(value(jnp.asarray(x + sign * step * direction))) for sign in (1, -1))
    np.testing.assert_allclose(float((slope * direction).sum()), (ahead - behind) / (2 * step), rtol=1e-6)
