import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import BSpline

from urbanjax.planning import basis


@pytest.fixture
def grid(x64):
    rng = np.random.default_rng(0)
    return 3.0, 0.7, rng.normal(size=9)


def test_hat_is_linear_interpolation(grid):
    start, spacing, values = grid
    query = np.linspace(1.0, 12.0, 57)
    expected = np.interp(query, start + spacing * np.arange(9), values)
    np.testing.assert_allclose(
        basis.interpolate(jnp.asarray(query), start, spacing, jnp.asarray(values)), expected, atol=1e-12
    )


def test_hat_goes_on_with_the_last_slope(grid):
    start, spacing, _ = grid
    query = jnp.array([start + spacing * 8 + 2.0])
    linear = 5.0 + 2.0 * jnp.arange(9.0)
    weights = basis.hat(query, start, spacing, 9, extrapolate=True)
    np.testing.assert_allclose(basis.product(weights, linear), [5 + 2 * (8 + 2.0 / spacing)])


def test_smooth_is_the_uniform_b_spline(grid):
    start, spacing, values = grid
    control = np.concatenate([[2 * values[0] - values[1]], values, values[-1:], values[-1:]])
    knots = start + spacing * np.arange(-3, 13)
    oracle = BSpline(knots, control, 3)
    query = start + spacing * np.linspace(0, 8.99, 101)
    found = basis.smooth(jnp.asarray(query), start, spacing, jnp.asarray(values))
    for order, value in enumerate(found):
        np.testing.assert_allclose(value, oracle.derivative(order)(query) if order else oracle(query), atol=1e-10)


def test_smooth_starts_at_the_first_value_and_holds_the_last(grid):
    start, spacing, values = grid
    value, first, second = basis.smooth(jnp.array([start, start + spacing * 20]), start, spacing, jnp.asarray(values))
    np.testing.assert_allclose(value, values[[0, -1]], atol=1e-12)
    assert first[1] == 0
    assert second[1] == 0


def test_smooth_derivatives_are_the_derivatives(grid):
    start, spacing, values = grid

    def part(i):
        return lambda q: basis.smooth(q[None], start, spacing, jnp.asarray(values))[i][0]

    for query in (3.01, 4.321, 6.5, 8.9):
        q = jnp.asarray(query)
        np.testing.assert_allclose(jax.grad(part(0))(q), part(1)(q), atol=1e-9)
        np.testing.assert_allclose(jax.grad(part(1))(q), part(2)(q), atol=1e-9)
