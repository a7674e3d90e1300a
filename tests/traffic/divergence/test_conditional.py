"""The divergence of lateral offsets given the station: known answers per bin, and a plain reference."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.traffic.divergence.conditional import conditional
from urbanjax.traffic.divergence.estimate import DivergenceParams

N, BINS = 1200, 6


@pytest.fixture(scope="module")
def estimate():
    return jax.jit(conditional, static_argnames=("bins", "pairs"))


def reference(x, x_bin, y, y_bin, k):
    """Bin by bin with full distance matrices; returns values, counts and whether they count."""
    values, counts = np.zeros(BINS), np.zeros(BINS)
    for b in range(BINS):
        a, c = x[x_bin == b].astype(float), y[y_bin == b].astype(float)
        if len(a) <= k or len(c) < k:
            continue
        r = np.sort(abs(a[:, None] - a[None]), axis=1)[:, k]
        s = np.sort(abs(a[:, None] - c[None]), axis=1)[:, k - 1]
        values[b], counts[b] = np.mean(np.log(s / r)) + np.log(len(c) / (len(a) - 1)), len(a)
    return values, counts


def test_equals_distance_matrices_bin_by_bin(estimate):
    rng = np.random.default_rng(0)
    offset = rng.normal(size=(3, N)).astype(np.float32) * [[1], [2], [0.5]]
    station_bin = rng.choice(BINS, (3, N), p=[0.4, 0.3, 0.2, 0.096, 0.002, 0.002])
    valid = np.arange(N) < [[N], [900], [700]]
    found = estimate(offset.astype(np.float32), station_bin, valid=valid, bins=BINS, params=DivergenceParams(ks=(1, 4)))
    pairs = [(i, j) for i in range(3) for j in range(3) if i != j]
    for row, (i, j) in enumerate(pairs):
        for column, k in enumerate((1, 4)):
            sides = (offset[i][valid[i]], station_bin[i][valid[i]], offset[j][valid[j]], station_bin[j][valid[j]])
            values, counts = reference(*sides, k)
            np.testing.assert_allclose(found.by_bin[row, column], np.where(counts, values, np.nan), atol=2e-5)
            np.testing.assert_array_equal(found.bins[row, column], counts > 0)
            np.testing.assert_allclose(found.value[row, column], (values * counts).sum() / counts.sum(), atol=2e-5)
            np.testing.assert_allclose(found.share[row, column], counts.sum() / valid[i].sum(), rtol=1e-6)
    assert found.valid.all()


def test_gaussians_given_the_bin(estimate):
    rng = np.random.default_rng(1)
    station_bin = np.tile(np.arange(N) % BINS, (2, 1))
    values = []
    for _ in range(20):
        centre = 5 * station_bin[0]  # what both share given the station does not count
        offset = np.stack([centre + rng.normal(size=N), centre + 2 * rng.normal(size=N)]).astype(np.float32)
        found = estimate(
            offset, station_bin, valid=np.ones((2, N), bool), bins=BINS, params=DivergenceParams(), pairs=((0, 1),)
        )
        values.append(float(found.value[0, 0]))
    truth = np.log(2) - 0.5 + 1 / 8
    assert abs(np.mean(values) - truth) < 0.05


def test_ties_are_counted(estimate):
    rng = np.random.default_rng(2)
    offset, station_bin = rng.normal(size=(2, N)).astype(np.float32), np.zeros((2, N), int)
    offset[0, :20] = 0.5
    every = np.ones((2, N), bool)
    found = estimate(offset, station_bin, valid=every, bins=BINS, params=DivergenceParams(), pairs=((0, 1),))
    assert not found.valid.any()
    assert np.isnan(found.value).all()
    assert found.ties.tolist() == [[20]]
    assert estimate(
        offset, station_bin, valid=every, bins=BINS, params=DivergenceParams(ties="dedupe"), pairs=((0, 1),)
    ).valid.all()
    # The same offset elsewhere on the course is no copy.
    apart = np.stack([np.where(np.arange(N) < 20, np.arange(N) % BINS, 0), station_bin[1]])
    kept = estimate(
        offset, apart, valid=every, bins=BINS, params=DivergenceParams(ks=(1,), ties="dedupe"), pairs=((0, 1),)
    )
    assert float(kept.share[0, 0]) == pytest.approx((N - 14 - 5) / (N - 14), abs=2e-3)


def test_gradients_equal_central_differences(x64):
    rng = np.random.default_rng(3)
    offset, station_bin = rng.normal(size=(2, 80)), rng.integers(0, 3, (2, 80))

    def value(x):
        return conditional(
            x, jnp.asarray(station_bin), valid=jnp.ones((2, 80), bool), bins=3, params=DivergenceParams(ks=(2,))
        ).value[0, 0]

    evaluate, step = jax.jit(jax.value_and_grad(value)), 1e-7
    slope = evaluate(jnp.asarray(offset))[1]
    direction = rng.normal(size=offset.shape)
    ahead, behind = (float(evaluate(jnp.asarray(offset + sign * step * direction))[0]) for sign in (1, -1))
    np.testing.assert_allclose(float((slope * direction).sum()), (ahead - behind) / (2 * step), rtol=1e-5)


@pytest.mark.parametrize("policy", ["error", "dedupe", "floor"])
def test_no_estimate_is_not_a_number_with_gradient_zero(policy):
    rng = np.random.default_rng(4)
    offset = jnp.asarray(rng.normal(size=(2, 80)), jnp.float32).at[1, 7].set(jnp.nan)
    station_bin = jnp.asarray(rng.integers(0, 3, (2, 80)))

    def value(x):
        found = conditional(
            x, station_bin, valid=jnp.ones((2, 80), bool), bins=4, params=DivergenceParams(ks=(2,), ties=policy)
        )
        return found.value[0, 0], found

    (number, found), slope = jax.jit(jax.value_and_grad(value, has_aux=True))(offset)
    assert np.isnan(number)
    assert not found.valid.any()
    np.testing.assert_array_equal(slope, 0)
    np.testing.assert_array_equal(np.isnan(found.by_bin), ~found.bins)
