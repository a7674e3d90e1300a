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


def test_acceleration_is_counted_over_time_and_braking_as_much(x64):
    time = jnp.linspace(0, 5, 91)
    for a, start in ((1.2, 3.0), (-1.2, 9.0)):
        speed = start + a * time
        step = jnp.diff(start * time + a * time**2 / 2)
        np.testing.assert_allclose(costs.acceleration(speed, step, time=time).sum(), 5 * 1.2**2, rtol=1e-10)
    still = costs.acceleration(jnp.full(91, 4.0), jnp.full(90, 5 * 4.0 / 90), time=time)
    np.testing.assert_array_equal(still, 0)


def test_deviation_counts_metres_squared_where_it_counts():
    offset, other = jnp.full(11, 1.5), jnp.full(11, 0.5)
    counts = (jnp.arange(11) <= 5) * 1.0
    np.testing.assert_allclose(costs.deviation(offset, other, counts=counts, step=jnp.ones(10)).sum(), 5.5, rtol=2e-3)


def test_gradients_at_coincident_points_are_finite():
    gradient = jax.grad(lambda p: costs.segments(p).sum())(jnp.zeros((4, 2)))
    rate = jax.grad(lambda s: costs.curvature_rate(jnp.arange(4.0), s).sum())(jnp.zeros(3))
    change = jax.grad(lambda s: costs.acceleration(jnp.arange(4.0), s, time=jnp.arange(4.0)).sum())(jnp.zeros(3))
    assert np.all(np.isfinite(gradient))
    assert np.all(np.isfinite(change))
    assert np.all(np.isfinite(rate))
