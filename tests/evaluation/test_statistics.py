"""Intervals cover what they should, are SciPy's where SciPy has them, and know that runs of one scene depend."""

import numpy as np
import pytest
from scipy import stats

from urbanjax.evaluation import statistics
from urbanjax.types import ScenarioError


def test_wilson_known_answer():
    """69 of 70 (Brown, Cai and DasGupta 2001 state the formula)."""
    n, k, z = 70, 69, stats.norm.ppf(0.975)
    centre, half = (k + z**2 / 2) / (n + z**2), z / (n + z**2) * np.sqrt(k * (n - k) / n + z**2 / 4)
    found = statistics.rate([True] * k + [False])
    np.testing.assert_allclose(found, [k / n, centre - half, centre + half], rtol=1e-9)
    assert found.percent.text() == "98.6 [92.3, 99.7]"
    assert list(found.flat("safe_share")) == ["safe_share", "safe_share_low", "safe_share_high"]


def test_bootstrap_of_a_mean_is_scipys():
    values = np.random.default_rng(0).gamma(2.0, size=60)
    found = statistics.mean(values)
    peer = stats.bootstrap((values,), np.mean, method="percentile", n_resamples=20_000, rng=1).confidence_interval
    np.testing.assert_allclose([found.low, found.high], [peer.low, peer.high], rtol=0.02)


def test_the_mean_of_groups_is_drawn_as_any_other_number_is(monkeypatch):
    rng = np.random.default_rng(3)
    values, groups = rng.normal(size=90), rng.integers(0, 20, 90)
    found = statistics.mean(values, groups=groups)
    one_by_one = statistics.bootstrap(lambda index: values[index].mean(), 90, groups=groups)
    np.testing.assert_allclose(found, one_by_one, rtol=1e-12)
    monkeypatch.setattr(statistics, "AT_ONCE", 300)
    np.testing.assert_allclose(statistics.mean(values, groups=groups), found, atol=0.02)


@pytest.mark.parametrize("by_group", [True, False])
def test_nineteen_of_twenty_intervals_hold_the_mean_if_groups_are_drawn_whole(by_group):
    """30 scenes of 5 runs that share most of their error."""
    rng, held = np.random.default_rng(1), []
    groups = np.repeat(np.arange(30), 5)
    for _ in range(200):
        values = np.repeat(rng.normal(size=30), 5) + 0.3 * rng.normal(size=150)
        found = statistics.bootstrap(
            lambda i, v=values: v[i].mean(), 150, groups=groups if by_group else None, draws=300
        )
        held.append(found.low <= 0 <= found.high)
    assert (np.mean(held) > 0.88) == by_group


def test_few_or_no_runs():
    assert np.isnan(statistics.rate([])).all()
    assert np.isnan(statistics.mean([])).all()
    one = statistics.mean([3.0])
    assert (one.value, one.text()) == (3.0, "3.0")
    assert np.isnan([one.low, one.high]).all()
    assert statistics.mean([]).text() == "-"
    single = statistics.mean([1.0, 2.0, 3.0], groups=["a"] * 3)
    assert single.low < 2 < single.high
    with pytest.raises(ScenarioError, match="2 groups for 3 runs"):
        statistics.mean([1.0, 2.0, 3.0], groups=[0, 1])


def test_stretches_are_consecutive_and_even():
    groups = statistics.stretches(100, 8)
    assert np.all(np.diff(groups) >= 0)
    assert set(np.bincount(groups)) <= {12, 13}
    assert statistics.stretches(3, 40).tolist() == [0, 1, 2]


def test_a_median_stands_between_order_statistics():
    assert statistics.median(np.arange(1.0, 11.0)) == (5.5, 2.0, 9.0)  # Conover's table for ten: 97.9 %
    assert statistics.median([3.0, np.inf, 1.0, np.inf, 2.0]) == (3.0, 1.0, np.inf)
    assert statistics.median([1.0, np.inf, np.inf, np.inf]).text(0) == "inf [1, inf]"
    assert statistics.median([]).text() == "-"


@pytest.mark.parametrize("count", [6, 15, 40])
def test_the_interval_of_a_median_holds_it_as_often_as_it_says(count):
    rng = np.random.default_rng(count)
    found = np.array([statistics.median(rng.exponential(size=count)) for _ in range(2000)])
    held = np.mean((found[:, 1] <= np.log(2)) & (np.log(2) <= found[:, 2]))
    assert 0.94 < held < 0.99
