"""Distances between routes: scipy's, known answers on lines, and the laws of a distance between sets."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.distance import directed_hausdorff

from urbanjax.traffic import similarity

samples = jax.jit(similarity.between_samples, static_argnames="block")
lines = jax.jit(similarity.between_lines, static_argnames=("closed", "block"))
FIELDS = ("mean", "rmse", "quantile", "hausdorff")


def route(n, seed, size=100.0):
    """A smooth wandering route of n samples at random spacing."""
    rng = np.random.default_rng(seed)
    at = np.sort(rng.uniform(0, 1, n))
    phase = rng.uniform(0, 2 * np.pi, (2, 3))
    waves = [sum(np.sin(k * 2 * at + phase[c, k - 1]) / k for k in (1, 2, 3)) for c in range(2)]
    return (size * np.stack(waves, -1)).astype(np.float32)


X, Y = route(60, 0), route(43, 1)
ALL_X, ALL_Y = np.ones(60, bool), np.ones(43, bool)


def values(found):
    return np.array([getattr(side, f) for side in (found.there, found.back) for f in FIELDS] + [found.mean])


@pytest.mark.parametrize("block", [7, 256])
def test_distances_between_samples_are_scipys(block):
    found = samples(X, Y, x_mask=ALL_X, y_mask=ALL_Y, level=0.9, block=block)
    for side, (a, b) in ((found.there, (X, Y)), (found.back, (Y, X))):
        near = cKDTree(b).query(a)[0]
        expected = [near.mean(), np.sqrt((near**2).mean()), np.quantile(near, 0.9), directed_hausdorff(a, b)[0]]
        np.testing.assert_allclose([getattr(side, f) for f in FIELDS], expected, rtol=1e-5)
    assert found.hausdorff == max(found.there.hausdorff, found.back.hausdorff)
    assert found.valid


def test_the_nearest_samples_are_the_trees():
    to_y, to_x = jax.jit(similarity.nearest, static_argnames="block")(X, Y, x_mask=ALL_X, y_mask=ALL_Y, block=16)
    np.testing.assert_array_equal(to_y, cKDTree(Y).query(X)[1])
    np.testing.assert_array_equal(to_x, cKDTree(X).query(Y)[1])


@pytest.mark.slow
def test_large_sets_are_searched_by_trees():
    x, y = route(2100, 2), route(2000, 3)
    assert len(x) * len(y) > similarity.PAIRS
    x_mask, y_mask = np.arange(2100) < 2050, np.arange(2000) < 1900
    found = samples(x, y, x_mask=x_mask, y_mask=y_mask)
    there, back = cKDTree(y[y_mask]).query(x[x_mask])[0], cKDTree(x[x_mask]).query(y[y_mask])[0]
    np.testing.assert_allclose([found.there.mean, found.back.mean], [there.mean(), back.mean()], rtol=1e-5)
    np.testing.assert_allclose([found.there.hausdorff, found.back.hausdorff], [there.max(), back.max()], rtol=1e-5)


def test_samples_carry_a_quarter_of_the_spacing_and_lines_do_not():
    x = np.stack([np.linspace(10, 90, 60), np.zeros(60)], -1).astype(np.float32)
    y = np.stack([2.5 * np.arange(43), np.zeros(43)], -1).astype(np.float32)
    assert samples(x, y, x_mask=ALL_X, y_mask=ALL_Y).there.mean == pytest.approx(2.5 / 4, rel=0.05)
    assert lines(x, y, x_mask=ALL_X, y_mask=ALL_Y).there.hausdorff == 0
    shifted = lines(x + np.float32([0, 3]), y, x_mask=ALL_X, y_mask=ALL_Y).there
    np.testing.assert_allclose([getattr(shifted, f) for f in FIELDS], 3, rtol=1e-6)


def test_a_closed_line_goes_on_from_its_last_sample_to_its_first():
    corners = np.float32([[0, 0], [10, 0], [10, 10], [0, 10], [7, 7]])
    mask = np.array([1, 1, 1, 1, 0], bool)
    beside = jnp.array([[-3.0, 4.0]])
    assert similarity.to_line(beside, jnp.asarray(corners), y_mask=jnp.asarray(mask))[0] == 5
    assert similarity.to_line(beside, jnp.asarray(corners), y_mask=jnp.asarray(mask), closed=True)[0] == 3


@pytest.mark.parametrize("compare", [samples, lines])
def test_distances_keep_under_motion_and_padding_and_swap_with_the_routes(compare):
    plain = values(compare(X, Y, x_mask=ALL_X, y_mask=ALL_Y))
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.float32([[c, s], [-s, c]])
    np.testing.assert_allclose(
        values(compare(X @ turn + 20, Y @ turn + 20, x_mask=ALL_X, y_mask=ALL_Y)), plain, rtol=1e-4
    )
    pad_x, pad_y = np.full((5, 2), np.nan, np.float32), np.zeros((4, 2), np.float32)
    padded = compare(
        np.concatenate([X, pad_x]), np.concatenate([Y, pad_y]), x_mask=np.arange(65) < 60, y_mask=np.arange(47) < 43
    )
    np.testing.assert_allclose(values(padded), plain, rtol=1e-6)
    swapped = compare(Y, X, x_mask=ALL_Y, y_mask=ALL_X)
    np.testing.assert_allclose(values(swapped)[[4, 5, 6, 7, 0, 1, 2, 3, 8]], plain, rtol=1e-6)
    assert np.all(values(compare(X, X, x_mask=ALL_X, y_mask=ALL_X)) < 1e-4)


def test_samples_may_come_in_any_order_and_lines_are_never_farther():
    found = samples(X, Y, x_mask=ALL_X, y_mask=ALL_Y)
    mixed = samples(
        np.random.default_rng(0).permutation(X), np.random.default_rng(1).permutation(Y), x_mask=ALL_X, y_mask=ALL_Y
    )
    np.testing.assert_allclose(values(mixed), values(found), rtol=1e-6)
    assert np.all(values(lines(X, Y, x_mask=ALL_X, y_mask=ALL_Y)) <= values(found) + 1e-5)


def test_hausdorff_obeys_the_triangle_inequality():
    z = route(60, 5)
    xy, yz = samples(X, Y, x_mask=ALL_X, y_mask=ALL_Y).hausdorff, samples(Y, z, x_mask=ALL_Y, y_mask=ALL_X).hausdorff
    assert samples(X, z, x_mask=ALL_X, y_mask=ALL_X).hausdorff <= xy + yz


def test_a_batch_equals_its_members():
    other = np.stack([Y, Y + 5])
    together = jax.jit(
        jax.vmap(
            lambda y: similarity.between_samples(
                jnp.asarray(X), y, x_mask=jnp.asarray(ALL_X), y_mask=jnp.asarray(ALL_Y), block=16
            )
        )
    )
    found = together(jnp.asarray(other))
    for i in range(2):
        np.testing.assert_allclose(found.mean[i], samples(X, other[i], x_mask=ALL_X, y_mask=ALL_Y).mean, rtol=1e-6)


@pytest.mark.parametrize("compare", [similarity.between_samples, similarity.between_lines])
def test_gradients_are_differences(compare, x64):
    x, y = route(9, 0).astype(float), route(7, 1).astype(float)
    masks = jnp.arange(9) < 8, jnp.arange(7) < 6

    @jax.jit
    def total(x, y):
        found = compare(x, y, x_mask=masks[0], y_mask=masks[1], level=0.8)
        return found.mean + found.there.rmse + found.back.quantile + found.hausdorff

    slopes = jax.jit(jax.grad(total, (0, 1)))(x, y)
    for place in np.ndindex(x.shape):
        step = np.zeros_like(x)
        step[place] = 1e-5
        assert slopes[0][place] == pytest.approx(float(total(x + step, y) - total(x - step, y)) / 2e-5, abs=1e-6)
    step = np.zeros_like(y)
    step[2, 1] = 1e-5
    assert slopes[1][2, 1] == pytest.approx(float(total(x, y + step) - total(x, y - step)) / 2e-5, abs=1e-6)


@pytest.mark.parametrize("compare", [similarity.between_samples, similarity.between_lines])
def test_degenerate_routes_have_finite_values_and_gradients(compare):
    same, nowhere, none = 3 * jnp.ones((4, 2)), jnp.full((4, 2), jnp.nan), jnp.zeros(4, bool)
    slope = jax.jit(jax.grad(lambda x, m: compare(x, same, x_mask=m, y_mask=jnp.ones(4, bool)).mean))
    assert np.isfinite(slope(same, jnp.ones(4, bool))).all()
    assert np.isfinite(slope(jnp.full((4, 2), jnp.nan), jnp.zeros(4, bool))).all()
    found = jax.jit(compare)(nowhere, same, x_mask=none, y_mask=~none)
    again = jax.jit(compare)(same, nowhere, x_mask=~none, y_mask=none)
    for nothing in (found, again):
        assert not nothing.valid
        assert np.all(values(nothing) == 0)


def test_single_precision_is_enough_far_from_the_origin(x64):
    far = np.array([3000.0, -4000.0])
    x, y = X.astype(float) + far, Y.astype(float) + far
    exact = values(samples(x, y, x_mask=ALL_X, y_mask=ALL_Y))
    np.testing.assert_allclose(
        values(samples(np.float32(x), np.float32(y), x_mask=ALL_X, y_mask=ALL_Y)), exact, rtol=1e-4
    )
