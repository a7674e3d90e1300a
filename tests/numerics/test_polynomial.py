"""Quintics against the printed 6x6 system of Eq. 17-18 in float64."""

import jax.numpy as jnp
import numpy as np

from urbanjax.numerics import polynomial


def test_equals_the_printed_system(x64):
    rng = np.random.default_rng(0)
    for _ in range(20):
        start, end, t = rng.normal(size=3) * 5, rng.normal(size=3) * 5, rng.uniform(0.5, 6)

        def rows(u):
            return [
                [1, u, u**2, u**3, u**4, u**5],
                [0, 1, 2 * u, 3 * u**2, 4 * u**3, 5 * u**4],
                [0, 0, 2, 6 * u, 12 * u**2, 20 * u**3],
            ]

        expected = np.linalg.solve(np.array(rows(0.0) + rows(t)), np.concatenate([start, end]))

        def to(state):
            return tuple(jnp.asarray(v) for v in state)

        actual = np.array(polynomial.quintic(to(start), to(end), duration=jnp.asarray(t)))
        np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-9)


def test_meets_both_ends_with_two_derivatives(x64):
    start, end, t = (1.0, 2.0, 0.5), (30.0, 9.0, -0.3), 3.0

    def to(state):
        return tuple(jnp.asarray(v) for v in state)

    coefficients = polynomial.quintic(to(start), to(end), duration=jnp.asarray(t))
    np.testing.assert_allclose(polynomial.evaluate(coefficients, jnp.asarray(0.0)), start, atol=1e-12)
    np.testing.assert_allclose(polynomial.evaluate(coefficients, jnp.asarray(t)), end, atol=1e-10)
