import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import TypeCheckError

from urbanjax.numerics import safe


def test_sqrt_equals_numpy_above_zero_and_is_flat_below():
    x = jnp.array([4.0, 0.25, 0.0, -1.0])
    np.testing.assert_array_equal(safe.sqrt(x), [2.0, 0.5, 0.0, 0.0])
    np.testing.assert_array_equal(jax.vmap(jax.grad(safe.sqrt))(x), [0.25, 1.0, 0.0, 0.0])


def test_sqrt_is_differentiable_twice_at_zero():
    assert jax.grad(jax.grad(safe.sqrt))(0.0) == 0


def test_norm_is_the_euclidean_norm_with_a_unit_gradient():
    x = jnp.array([3.0, -4.0])
    assert safe.norm(x) == 5
    np.testing.assert_allclose(jax.grad(safe.norm)(x), [0.6, -0.8], rtol=1e-6)


def test_norm_of_the_zero_vector_has_zero_gradient():
    np.testing.assert_array_equal(jax.grad(safe.norm)(jnp.zeros(3)), np.zeros(3))


def test_norm_takes_the_last_axis():
    x = jnp.arange(12.0).reshape(2, 3, 2)
    np.testing.assert_allclose(safe.norm(x), np.linalg.norm(np.asarray(x), axis=-1), rtol=1e-6)


def test_divide_by_zero_is_the_alternative_with_zero_gradient():
    a, b = jnp.array([6.0, 1.0, 0.0]), jnp.array([3.0, 0.0, 0.0])
    np.testing.assert_array_equal(safe.divide(a, b), [2.0, 0.0, 0.0])
    np.testing.assert_array_equal(safe.divide(a, b, otherwise=7.0), [2.0, 7.0, 7.0])
    for argument in (0, 1):
        slope = jax.grad(lambda a, b: safe.divide(a, b).sum(), argnums=argument)(a, b)
        expected = [1 / 3, 0, 0] if argument == 0 else [-2 / 3, 0, 0]
        np.testing.assert_allclose(slope, expected, rtol=1e-6)


def test_divide_by_tiny_or_negative_is_plain_division():
    np.testing.assert_allclose(safe.divide(jnp.array([1.0, 1.0]), jnp.array([-2.0, 1e-30])), [-0.5, 1e30], rtol=1e-6)


def test_arctan2_equals_numpy_and_is_zero_at_the_origin():
    angle = np.linspace(-3.1, 3.1, 13).astype(np.float32)
    np.testing.assert_allclose(safe.arctan2(jnp.sin(angle), jnp.cos(angle)), angle, rtol=1e-5, atol=1e-6)
    assert safe.arctan2(jnp.zeros(()), jnp.zeros(())) == 0
    for argument in (0, 1):
        assert jax.grad(safe.arctan2, argnums=argument)(jnp.zeros(()), jnp.zeros(())) == 0


def test_arctan_is_the_arctangent_in_both_precisions(x64):
    x = np.concatenate([-np.logspace(-6, 8, 300)[::-1], [0.0], np.logspace(-6, 8, 300)])
    single = np.asarray(safe.arctan(jnp.asarray(x, jnp.float32)))
    assert single.dtype == np.float32
    assert np.abs(single - np.arctan(np.float32(x).astype(float))).max() < 4e-7
    np.testing.assert_allclose(safe.arctan(jnp.asarray(x)), np.arctan(x), rtol=1e-14)
    np.testing.assert_array_equal(single, -single[::-1])


def test_arctan_has_its_derivative_and_no_overflow():
    x = jnp.array([0.0, 0.3, -1.0, 30.0, 3e5])
    np.testing.assert_allclose(jax.vmap(jax.grad(safe.arctan))(x), 1 / (1 + x * x), rtol=1e-6)
    for far in (1e25, -jnp.inf):
        assert safe.arctan(jnp.float32(far)) == pytest.approx(np.sign(far) * np.pi / 2)
        assert jax.grad(safe.arctan)(jnp.float32(far)) == 0


@pytest.mark.parametrize("turns", [-3, -1, 0, 1, 4])
def test_wrapped_angle_is_in_range_and_the_same_direction(x64, turns):
    angle = jnp.linspace(-3.14, 3.14, 21) + 2 * np.pi * turns
    wrapped = safe.wrap_angle(angle)
    assert float(wrapped.min()) >= -np.pi
    assert float(wrapped.max()) < np.pi
    np.testing.assert_allclose(jnp.exp(1j * wrapped), jnp.exp(1j * angle), atol=1e-12)


def test_wrap_angle_of_pi_is_minus_pi_and_its_slope_is_one():
    assert safe.wrap_angle(jnp.asarray(np.float32(np.pi))) == -np.float32(np.pi)
    assert jax.grad(safe.wrap_angle)(9.0) == 1


def test_shapes_are_checked_in_the_suite():
    with pytest.raises(TypeCheckError):
        safe.arctan2(jnp.zeros(2), jnp.zeros(3))


@pytest.mark.parametrize("axis", [0, 1, -1])
def test_smallest_and_largest_of_an_axis_with_the_derivative_of_one_entry(axis):
    x = jnp.array([[3.0, 1.0, 2.0], [0.5, 4.0, 2.0]])
    for found, wanted in ((safe.minimum, jnp.min), (safe.maximum, jnp.max)):
        np.testing.assert_array_equal(found(x, axis), wanted(x, axis=axis))
        slope = jax.grad(lambda v, f=found: f(v, axis).sum())(x)
        np.testing.assert_array_equal(slope.sum(), wanted(x, axis=axis).size)
    tied = jax.grad(lambda v: safe.minimum(v))(jnp.ones(3))
    np.testing.assert_array_equal(tied, [1.0, 0.0, 0.0])
    np.testing.assert_allclose(jax.jvp(safe.maximum, (x,), (2 * x,))[1], 2 * jnp.max(x, axis=-1))
