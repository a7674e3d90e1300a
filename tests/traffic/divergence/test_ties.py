"""Samples that coincide: counted under each policy, and never silently given a number."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.traffic.divergence.estimate import DivergenceParams, divergence
from urbanjax.traffic.divergence.ties import duplicates

N, COPIES = 600, 30
ONE = ((0, 1),)
KS = (1, 5)


@pytest.fixture(scope="module")
def sets():
    """Two teams, the first with 30 copies of each of two places, one of them also a place of the second."""
    rng = np.random.default_rng(0)
    points = rng.normal(size=(2, N, 2)).astype(np.float32)
    points[0, :COPIES], points[0, COPIES : 2 * COPIES] = points[1, 7], [3.0, 3.0]
    return jnp.asarray(points), jnp.ones((2, N), bool)


@pytest.fixture(scope="module")
def estimate():
    return jax.jit(divergence, static_argnames="pairs")


def test_copies_are_found_and_one_of_each_is_kept(sets):
    points, valid = sets
    copies = duplicates(points[0], valid[0])
    assert int(copies[: 2 * COPIES].sum()) == 2 * COPIES - 2
    assert not copies[2 * COPIES :].any()
    few = valid[0] & (jnp.arange(N) >= COPIES - 1)
    assert int(duplicates(points[0], few).sum()) == COPIES - 1


def test_error_gives_no_value_and_says_how_many(sets, estimate):
    found = estimate(*sets, params=DivergenceParams(ks=KS), pairs=ONE)
    assert not found.valid.any()
    assert found.ties_own.tolist() == [[2 * COPIES] * 2]
    assert found.ties_other.tolist() == [[COPIES, 0]]


def test_dedupe_leaves_copies_out(sets, estimate):
    points, valid = sets
    found = estimate(points, valid, params=DivergenceParams(ks=KS, ties="dedupe"), pairs=ONE)
    assert found.valid.all()
    assert found.dropped.tolist() == [2 * COPIES - 2, 0]
    assert found.ties_other.tolist() == [[1, 0]]  # the place that both have stays, and has no logarithm for k = 1
    assert found.used.sum(-1).tolist() == [[N - 2 * COPIES + 1, N - 2 * COPIES + 2]]
    without = estimate(
        points,
        valid & ~jnp.stack([duplicates(points[0], valid[0]), ~valid[1]]),
        params=DivergenceParams(ks=KS),
        pairs=ONE,
    )
    assert float(found.value[0, 1]) == pytest.approx(float(without.value[0, 1]), abs=1e-6)


def test_jitter_moves_samples_apart_by_at_most_its_size(sets, estimate):
    points, valid = sets
    params = DivergenceParams(ks=KS, ties="jitter", size=0.01)
    found = estimate(points, valid, params=params, pairs=ONE, key=jax.random.key(0))
    assert found.valid.all()
    assert found.ties_own.tolist() == [[0, 0]]
    other = estimate(points, valid, params=params, pairs=ONE, key=jax.random.key(1))
    assert 0 < abs(float(found.value[0, 1] - other.value[0, 1])) < 0.1
    with pytest.raises(ValueError, match="random key"):
        divergence(points, valid, params=params, pairs=ONE)


def test_floor_raises_distances_and_counts_them(sets, estimate):
    values = {}
    for size in (1e-3, 1e-2):
        found = estimate(*sets, params=DivergenceParams(ks=KS, ties="floor", size=size), pairs=ONE)
        assert found.valid.all()
        assert found.ties_own.tolist() == [[2 * COPIES] * 2]
        values[size] = float(found.value[0, 1])
    # 60 of 600 samples with r = floor and s above it: what the floor is decides the estimate.
    assert values[1e-3] - values[1e-2] == pytest.approx(2 * 60 / N * np.log(10), abs=0.02)


@pytest.mark.slow
def test_without_ties_all_policies_agree(estimate):
    points = jnp.asarray(np.random.default_rng(1).normal(size=(2, N, 2)), jnp.float32)
    values = [
        float(
            estimate(
                points,
                jnp.ones((2, N), bool),
                params=DivergenceParams(ks=KS, ties=policy, size=1e-7),
                pairs=ONE,
                key=key,
            ).value[0, 1]
        )
        for policy, key in (("error", None), ("dedupe", None), ("floor", None), ("jitter", jax.random.key(0)))
    ]
    np.testing.assert_allclose(values, values[0], atol=2e-5)
