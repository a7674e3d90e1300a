"""What goes tile by tile is what goes all at once."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.numerics.tiles import in_tiles


def distances(shared, rows):
    """Of each row to some places, and their sum of squares. Args: shared, scale and places [m, 2]; rows, [n, 2]."""
    scale, places = shared
    apart = rows["at"][:, None, :] - places[None, :, :]
    return scale * jnp.sum(apart**2, axis=-1), {"sum": jnp.sum(jnp.sin(apart), axis=(1, 2)) * rows["weight"]}


def inputs(n):
    rng = np.random.default_rng(n)
    shared = jnp.asarray(1.7), jnp.asarray(rng.normal(size=(3, 2)))
    return shared, {"at": jnp.asarray(rng.normal(size=(n, 2))), "weight": jnp.asarray(rng.normal(size=n))}


def total(function):
    def summed(shared, rows):
        squares, others = function(shared, rows)
        return jnp.sum(squares * jnp.arange(3.0)[None, :]) + jnp.sum(others["sum"] ** 2)

    return summed


@pytest.mark.parametrize(("n", "size"), [(1, 4), (8, 4), (7, 3), (10, 100)])
def test_values_and_derivatives_in_both_modes_are_those_of_the_function(n, size, x64):
    shared, rows = inputs(n)
    tiled = lambda shared, rows: in_tiles(lambda tile: distances(shared, tile), rows, size=size)  # noqa: E731
    for found, expected in zip(
        jax.tree.leaves(tiled(shared, rows)), jax.tree.leaves(distances(shared, rows)), strict=True
    ):
        np.testing.assert_array_equal(found, expected)
    gradients = (jax.grad(total(f), argnums=(0, 1))(shared, rows) for f in (tiled, distances))
    for found, expected in zip(*map(jax.tree.leaves, gradients), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
    along = jax.tree.map(jnp.ones_like, (shared, rows))
    slopes = [jax.jvp(total(f), (shared, rows), along)[1] for f in (tiled, distances)]
    np.testing.assert_allclose(*slopes, rtol=1e-12)


def test_a_batch_of_them_has_the_same_derivative(x64):
    shared, rows = inputs(6)
    batch = jax.tree.map(lambda x: jnp.stack([x, 2 * x]), rows)
    slope = lambda f: jax.vmap(jax.grad(total(f), argnums=1), in_axes=(None, 0))(shared, batch)  # noqa: E731
    found = slope(lambda shared, rows: in_tiles(lambda tile: distances(shared, tile), rows, size=2))
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(slope(distances)), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)


@pytest.mark.parametrize("n", [1, 5, 6, 11])
def test_tiles_are_put_together_in_order(n):
    rows = jnp.arange(float(n))
    np.testing.assert_array_equal(in_tiles(lambda x: 2 * x, rows, size=3), 2 * rows)
