import jax
import numpy as np
import pytest
from scipy.signal import savgol_filter

from urbanjax.numerics.savgol import savgol, savgol_matrix

FILTERS = [(8, 2, 0), (15, 2, 1), (5, 2, 1), (5, 3, 2), (6, 3, 1), (1, 0, 0)]


@pytest.mark.parametrize(("window", "order", "derivative"), FILTERS)
def test_as_scipy_has_it_for_every_length(x64, window, order, derivative):
    values = np.random.default_rng(0).normal(size=40)
    ours = jax.jit(lambda x, n: savgol(x, n, window=window, order=order, derivative=derivative, spacing=0.1))
    for n in range(window, 41):
        wanted = savgol_filter(values[:n], window, order, deriv=derivative, delta=0.1)
        np.testing.assert_allclose(ours(values, n)[:n], wanted, atol=1e-9)


def test_fewer_values_than_the_window_are_filled_up():
    values = np.random.default_rng(0).normal(size=40).astype(np.float32)
    ours = jax.jit(lambda x, n: savgol(x, n, window=8, order=2))
    np.testing.assert_allclose(ours(values, 5)[:5], savgol_filter(values[:8], 8, 2)[:5], atol=1e-5)
    np.testing.assert_allclose(ours(values[:4], 4), savgol_filter(values[:4], 4, 2), atol=1e-5)
    np.testing.assert_allclose(ours(values[:2], 2), values[:2], atol=1e-5)


@pytest.mark.parametrize(
    ("window", "order", "derivative"), [(41, 2, 0), (41, 2, 1), (5, 2, 1), (5, 3, 2), (8, 2, 0), (9, 2, 0)]
)
def test_the_matrix_is_the_filter(window, order, derivative):
    values = np.random.default_rng(0).normal(size=41)
    expected = savgol_filter(values, window, order, deriv=derivative)
    np.testing.assert_allclose(
        savgol_matrix(41, window, order=order, derivative=derivative) @ values, expected, atol=1e-12
    )


def test_the_matrix_keeps_polynomials_and_few_values():
    x = np.arange(6.0)
    np.testing.assert_allclose(savgol_matrix(6, 5, order=2, derivative=1) @ x**2, 2 * x, atol=1e-9)
    np.testing.assert_allclose(savgol_matrix(2, 5, order=2, derivative=1) @ np.array([1.0, 3.0]), [2, 2])
    np.testing.assert_array_equal(savgol_matrix(1, 5, order=2, derivative=1), [[0]])
