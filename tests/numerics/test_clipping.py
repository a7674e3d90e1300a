"""A bound on what is carried back: exact below it, the direction kept above it, and what is not finite stays so."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.numerics.clipping import clip_cotangent

GAIN = np.array([[3.0, 1.0], [-1.0, 2.0]])
STEPS = 12


def gradient(most, gain=GAIN):
    """Of the first entry after twelve steps, each of which multiplies by a matrix; by where they began."""

    def loss(x):
        def step(so_far, _):
            values, count = clip_cotangent(so_far, most)
            return (values @ gain, count + 1), None

        (last, _), _ = jax.lax.scan(step, (x, jnp.zeros((), int)), length=STEPS)
        return last[0]

    return jax.grad(loss)(jnp.array([0.3, -0.2]))


def expected(most):
    carried = np.array([1.0, 0.0])
    for _ in range(STEPS):
        carried = GAIN @ carried
        carried = carried * min(1.0, most / np.linalg.norm(carried))
    return carried


@pytest.mark.parametrize("most", [1e12, 7.0, 0.5])
def test_what_is_carried_back_is_clipped_in_each_step(most, x64):
    np.testing.assert_allclose(gradient(most), expected(most), rtol=1e-12)


def test_no_gradient_overflows():
    steep = 1e6 * GAIN
    assert not np.isfinite(gradient(1e30, steep)).all()
    np.testing.assert_allclose(np.linalg.norm(gradient(10.0, steep)), 10.0, rtol=1e-5)


def test_every_row_of_a_batch_has_its_own_norm(x64):
    def loss(x):
        return jnp.sum(clip_cotangent(x, 1.0) * jnp.array([3.0, 4.0]))

    one = jax.vmap(jax.grad(loss))(jnp.zeros((2, 2)))
    np.testing.assert_allclose(one, np.full((2, 2), [0.6, 0.8]), rtol=1e-12)


def test_not_a_number_stays(x64):
    def loss(x):
        return jnp.sum(jnp.log(clip_cotangent(x, 1.0)))

    with jax.debug_nans(False):
        assert np.isnan(jax.grad(loss)(jnp.array([1.0, 0.0]))).all()  # infinite: named by who asks


def test_integers_pass():
    def loss(x):
        values, count = clip_cotangent((x, jnp.arange(3)), 1.0)
        return jnp.sum(values) * count[1]

    np.testing.assert_allclose(jax.grad(loss)(jnp.zeros(4)), np.full(4, 0.5))
