import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.vehicle.limits import approach_speed, curve_speed, stop_speed, stopping_distance


def test_curve_speed_gives_the_lateral_acceleration():
    curvature = jnp.asarray([0.1, -0.1, 0.02])
    np.testing.assert_allclose(curve_speed(curvature, 2.0, cap=30.0) ** 2 * jnp.abs(curvature), 2.0, rtol=1e-5)


def test_curve_speed_is_capped_on_the_straight():
    np.testing.assert_allclose(curve_speed(jnp.asarray([0.0, 1e-9]), 2.0, cap=13.0), 13.0, rtol=1e-6)
    assert curve_speed(jnp.asarray(0.0), 2.0, cap=0.0) < 0.02


def test_stop_speed_inverts_the_stopping_distance():
    speed = jnp.asarray([0.0, 3.0, 20.0])
    np.testing.assert_allclose(stop_speed(stopping_distance(speed, 2.5), 2.5), speed, rtol=1e-5)
    with_reaction = stop_speed(stopping_distance(speed, 2.5) + 0.8 * speed, 2.5, reaction_time=0.8)
    np.testing.assert_allclose(with_reaction, speed, rtol=1e-5, atol=1e-5)
    assert stop_speed(jnp.asarray(-4.0), 2.5, reaction_time=0.8) == 0


def test_approach_speed_ends_at_the_target():
    speed = approach_speed(jnp.asarray(10.0), jnp.asarray(4.0), deceleration=2.0)
    np.testing.assert_allclose(speed**2 - 2 * 2.0 * 10.0, 16.0, rtol=1e-5)


def test_gradients_are_finite_at_the_edges():
    zero = jnp.asarray(0.0)
    assert np.isfinite(jax.grad(curve_speed)(zero, 2.0, cap=13.0))
    assert np.isfinite(jax.grad(curve_speed)(zero, 2.0, cap=0.0))
    assert np.isfinite(jax.grad(stop_speed)(zero, 2.0))
    assert np.isclose(jax.grad(stop_speed)(jnp.asarray(1e-6), 2.0, reaction_time=0.5), 2.0, rtol=1e-3)
    assert np.isfinite(jax.grad(approach_speed)(zero, zero, deceleration=2.0))
