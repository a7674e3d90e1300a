import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.numerics import lean

X = jnp.array([-2.0, -1.0, 0.0, 0.5, 1.0, 3.0])


def test_values_are_those_of_their_namesakes():
    y = X[::-1]
    assert jnp.array_equal(lean.maximum(X, 0.5), jnp.maximum(X, 0.5))
    assert jnp.array_equal(lean.minimum(X, 0.5), jnp.minimum(X, 0.5))
    assert jnp.array_equal(lean.maximum(X, y), jnp.maximum(X, y))
    assert jnp.array_equal(lean.minimum(X[:, None], y[None, :]), jnp.minimum(X[:, None], y[None, :]))
    assert jnp.array_equal(lean.clip(X, -1.0, 1.0), jnp.clip(X, -1.0, 1.0))
    assert jnp.array_equal(lean.clip(X, -1.0, y), jnp.minimum(jnp.maximum(X, -1.0), y))
    assert jnp.array_equal(lean.clip(jnp.arange(5), 1, 3), jnp.array([1, 1, 2, 3, 3]))


def test_a_nan_stays_one():
    nan = jnp.full(6, jnp.nan)
    for got in (lean.maximum(nan, 0.0), lean.minimum(nan, X), lean.maximum(X, nan), lean.clip(nan, 0.0, 1.0)):
        assert jnp.all(jnp.isnan(got))


def slopes(function) -> list[float]:
    return jax.vmap(jax.grad(function))(X).tolist()


def test_where_both_are_equal_the_first_has_the_derivative():
    assert slopes(lambda x: lean.maximum(x, 0.5)) == [0, 0, 0, 1, 1, 1]
    assert slopes(lambda x: lean.minimum(x, 0.5)) == [1, 1, 1, 1, 0, 0]
    assert slopes(lambda x: lean.clip(x, -1.0, 1.0)) == [0, 1, 1, 1, 1, 0]
    bound = jnp.asarray(0.5)
    for function, first in ((lean.maximum, [0, 0, 0, 1, 1, 1]), (lean.minimum, [1, 1, 1, 1, 0, 0])):
        by_both = jax.vmap(jax.grad(function, argnums=(0, 1)), in_axes=(0, None))(X, bound)
        assert by_both[0].tolist() == first
        assert (by_both[0] + by_both[1]).tolist() == [1.0] * 6


@pytest.mark.parametrize("function", [lean.maximum, lean.minimum])
def test_the_derivative_goes_to_what_was_broadcast(function):
    column, row = jnp.array([[0.0], [2.0]]), jnp.array([[1.0, 1.0, 3.0]])
    by_column, by_row = jax.grad(lambda a, b: jnp.sum(function(a, b)), argnums=(0, 1))(column, row)
    larger = jnp.array([[0, 0, 0], [1, 1, 0]])
    taken = larger if function is lean.maximum else 1 - larger
    assert by_column[:, 0].tolist() == jnp.sum(taken, axis=1).tolist()
    assert by_row[0].tolist() == jnp.sum(1 - taken, axis=0).tolist()


@pytest.mark.parametrize("shape", [(1,), (7,), (3, 40), (2, 3, 5)])
def test_the_first_least_entry_is_that_of_jax(shape):
    x = np.random.default_rng(0).integers(0, 4, shape).astype(np.float32)  # of ties there are many
    for each in (x, np.where(x > 1, np.inf, x), np.full(shape, np.inf, np.float32)):
        found = lean.argmin(jnp.asarray(each))
        np.testing.assert_array_equal(found, jnp.argmin(each, axis=-1))
        assert found.dtype == jnp.int32


def test_the_first_least_entry_of_sums_is_found_however_they_are_compiled():
    a, b, c = (jnp.asarray(x, jnp.float32) for x in np.random.default_rng(1).normal(size=(3, 500, 60)))
    found = jax.jit(lambda a, b, c: lean.argmin(a * b + c))(a, b, c)
    np.testing.assert_array_equal(found, jax.jit(lambda a, b, c: jnp.argmin(a * b + c, axis=-1))(a, b, c))
