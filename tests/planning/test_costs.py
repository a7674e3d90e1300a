import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.planning import costs


def test_hinge_barrier_is_exactly_zero_beyond_its_threshold():
    np.testing.assert_allclose(costs.barrier(jnp.array([0.3, 0.8, 2.0]), 0.8), [0.25, 0, 0], atol=1e-7)


def test_integrals_on_a_circle(x64):
    angle = jnp.linspace(0, jnp.pi / 2, 91)
    position = 20 * jnp.stack([jnp.sin(angle), 1 - jnp.cos(angle)], axis=-1)
    step, kappa = costs.segments(position), jnp.full(91, 1 / 20)
    np.testing.assert_allclose(step.sum(), 10 * np.pi, rtol=1e-4)
    np.testing.assert_allclose(costs.curvature(kappa, step).sum(), np.pi / 2, rtol=3e-3)
    np.testing.assert_allclose(costs.curvature(-kappa, step), costs.curvature(kappa, step))
    assert np.all(costs.curvature_rate(kappa, step) == 0)
    time = jnp.linspace(0, 5, 91)
    np.testing.assert_allclose(
        costs.lateral_acceleration(jnp.full(91, 4.0), kappa, time=time).sum(), 5 * 0.8**2, rtol=1e-12
    )
    np.testing.assert_allclose(costs.slowness(jnp.full(91, 4.0), jnp.full(91, 7.0), time=time).sum(), 45, rtol=1e-12)


def test_deviation_counts_metres_squared_where_it_counts():
    offset, other = jnp.full(11, 1.5), jnp.full(11, 0.5)
    counts = (jnp.arange(11) <= 5) * 1.0
    np.testing.assert_allclose(costs.deviation(offset, other, counts=counts, step=jnp.ones(10)).sum(), 5.5, rtol=2e-3)


def test_gradients_at_coincident_points_are_finite():
    gradient = jax.grad(lambda p: costs.segments(p).sum())(jnp.zeros((4, 2)))
    rate = jax.grad(lambda s: costs.curvature_rate(jnp.arange(4.0), s).sum())(jnp.zeros(3))
    assert np.all(np.isfinite(gradient))
    assert np.all(np.isfinite(rate))
