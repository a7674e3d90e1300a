"""Intervals hold the truth as often as they say; laps driven alike belong to the null of laps dealt out anew."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.numerics import masked
from urbanjax.traffic.divergence.estimate import DivergenceParams, divergence
from urbanjax.traffic.resampling import ResamplingParams, consecutive, interval, lap_swap

ONE = ((0, 1),)


def test_blocks_are_consecutive_and_of_equal_size():
    valid = np.arange(103) < [[103], [60]]
    valid[1, 10:20] = False
    block = np.asarray(consecutive(jnp.asarray(valid), 10))
    for mask, number in zip(valid, block, strict=True):
        sizes = np.bincount(number[mask], minlength=10)
        assert sizes.max() - sizes.min() <= 1
        assert np.all(np.diff(number[mask]) >= 0)


def test_deviation_of_a_mean_is_that_of_independent_samples():
    rng = np.random.default_rng(0)
    x = jnp.asarray(rng.normal(size=(2, 400)), jnp.float32)

    def statistic(mask):
        mean = masked.mean(x, mask)
        return mean[0] - mean[1], jnp.any(mask)

    valid = jnp.ones((2, 400), bool)
    params = ResamplingParams(draws=2000)
    found = interval(statistic, valid, block=consecutive(valid, params.blocks), key=jax.random.key(0), params=params)
    expected = np.sqrt(2 / 400)
    assert float(found.deviation) == pytest.approx(expected, rel=0.25)
    assert float(found.high - found.low) == pytest.approx(2 * 1.96 * expected, rel=0.25)
    together = interval(
        statistic, valid, block=consecutive(valid, params.blocks), key=jax.random.key(0), params=params, paired=True
    )
    assert float(together.deviation) == pytest.approx(expected, rel=0.3)  # independent sets: pairing changes nothing


def covered(repetitions, n):
    params, rng = ResamplingParams(draws=100), np.random.default_rng(1)
    valid = jnp.ones((2, n), bool)

    @jax.jit
    def one(points, key):
        def statistic(mask):
            found = divergence(points, mask, params=DivergenceParams(), pairs=ONE)
            return found.value[0, 0], found.valid[0, 0]

        return interval(statistic, valid, block=consecutive(valid, params.blocks), key=key, params=params)

    hits = 0
    for i in range(repetitions):
        points = jnp.asarray(rng.normal(size=(2, n, 2)) * [[[1]], [[2]]], jnp.float32)
        found = one(points, jax.random.key(i))
        assert bool(found.valid)
        hits += bool((found.low < 0.6363) & (found.high > 0.6363))
    return hits / repetitions


@pytest.mark.slow
def test_intervals_cover_the_truth_as_often_as_they_say():
    assert 0.90 <= covered(200, 1000) <= 0.98


def test_laps_driven_alike_belong_to_the_null_and_others_do_not():
    rng = np.random.default_rng(2)
    lap = np.repeat(np.arange(6), 100)
    deals = np.array([[i in first for i in range(6)] for first in itertools.combinations(range(6), 3)])
    assert deals[0].tolist() == [True] * 3 + [False] * 3

    @jax.jit
    def swapped(points):
        def statistic(mask):
            found = divergence(jnp.stack([points, points]), mask, params=DivergenceParams(), pairs=ONE)
            return found.value[0], found.valid[0]

        return lap_swap(statistic, jnp.asarray(lap), valid=jnp.ones(600, bool), deals=jnp.asarray(deals))

    alike = swapped(jnp.asarray(rng.normal(size=(600, 2)), jnp.float32))
    assert alike.null.shape == (19, 1)
    assert alike.valid.all()
    assert abs(float(alike.excess[0])) < 0.15
    assert float(alike.share[0]) > 0.05
    moved = swapped(jnp.asarray(rng.normal(size=(600, 2)) + np.where(lap < 3, 0, 1.5)[:, None], jnp.float32))
    assert float(moved.excess[0]) > 0.5
    assert float(moved.share[0]) <= 0.1 + 1e-6  # it and its mirror image are the largest of twenty


def test_what_is_not_valid_is_not_a_number():
    x = jnp.asarray(np.random.default_rng(6).normal(size=(2, 40)), jnp.float32)

    def statistic(mask):
        mean = masked.mean(x, mask)
        return jnp.stack([mean[0], mean[1]]), jnp.stack([jnp.any(mask), jnp.all(mask)])  # the second of the whole only

    every, params = jnp.ones((2, 40), bool), ResamplingParams(draws=10, blocks=10)
    found = interval(statistic, every, block=consecutive(every, 10), key=jax.random.key(0), params=params)
    assert found.valid.tolist() == [True, False]
    for side in (found.low, found.high, found.deviation):
        assert np.isnan(side).tolist() == [False, True]
    deals = jnp.asarray([[True, False], [False, True]])
    swap = lap_swap(statistic, jnp.arange(40) % 2, valid=every[0], deals=deals)
    assert swap.valid.tolist() == [True, False]
    assert np.isnan(swap.excess).tolist() == np.isnan(swap.share).tolist() == [False, True]
