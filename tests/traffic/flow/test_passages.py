"""A detector's passages and headways, travel times, and the Gini coefficient."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.traffic.flow import passages as flow

find = jax.jit(flow.passages, static_argnames="laps")
TIME = np.arange(0, 60, 0.5).astype(np.float32)
START = np.array([[0.0], [-20], [-70]])
WAY = np.float32(10 * TIME + START)
ALL = np.ones(WAY.shape, bool)


def test_passages_come_in_order_with_their_headways():
    for rows in ([0, 1, 2], [2, 0, 1]):
        found = find(WAY[rows], TIME, mask=ALL, station=103.0)
        np.testing.assert_allclose(found.time, [10.3, 12.3, 17.3], rtol=1e-5)
        np.testing.assert_allclose(found.headway, [0, 2, 5], rtol=1e-4)
        np.testing.assert_array_equal(np.array(rows)[found.vehicle], [0, 1, 2])
        assert found.count == 3


def test_throughput_is_passages_per_second():
    found = find(WAY, TIME, mask=ALL, station=103.0)
    np.testing.assert_allclose(flow.throughput(found, jnp.array([0.0, 10.0, 15.0, 25.0])), [0, 0.4, 0.1], rtol=1e-5)


def test_a_closed_course_is_passed_every_lap_and_absent_vehicles_never():
    mask = ALL.copy()
    mask[1] = False
    found = find(np.where(mask, WAY, np.nan), TIME, mask=mask, station=50.0, margin=2.0, length=200.0, laps=4)
    assert found.count == 6
    np.testing.assert_allclose(found.time[:6], [5, 12, 25, 32, 45, 52], rtol=1e-5)
    np.testing.assert_array_equal(found.vehicle[:6], [0, 2, 0, 2, 0, 2])
    assert not found.valid[6:].any()
    assert np.all(found.headway[6:] == 0)


def test_travel_times_between_stations():
    way = np.float32(np.array([[10.0], [8.0], [1.0]]) * TIME)
    seconds, both = jax.jit(flow.travel_times)(way, TIME, mask=ALL, start=21.0, end=101.0)
    np.testing.assert_allclose(seconds, [8, 10, 0], rtol=1e-5)
    np.testing.assert_array_equal(both, [True, True, False])


@pytest.mark.parametrize(
    ("values", "mask", "expected"),
    [
        ([5.0, 5, 5, 5], [1, 1, 1, 1], 0),
        ([0.0, 0, 7, 0], [1, 1, 1, 1], 0.75),
        ([1.0, 2, 3, 4], [1, 1, 1, 1], 0.25),
        ([4.0, 99, 1, 3], [1, 0, 1, 1], 0.25),
        ([1.0, np.nan, np.nan, np.nan], [1, 0, 0, 0], 0),
        ([1.0, 2, 3, 4], [0, 0, 0, 0], 0),
        ([0.0, 0, 0, 0], [1, 1, 1, 1], 0),
    ],
)
def test_gini_of_known_spreads(values, mask, expected):
    found, slope = jax.jit(jax.value_and_grad(flow.gini))(jnp.array(values), jnp.array(mask, bool))
    assert found == pytest.approx(expected, abs=1e-6)
    assert np.isfinite(slope).all()


def test_gini_is_half_the_relative_mean_difference_and_ignores_scale():
    x = np.random.default_rng(0).gamma(2, size=(2, 30)).astype(np.float32)
    expected = np.abs(x[:, :, None] - x[:, None]).mean((1, 2)) / (2 * x.mean(1))
    gini = jax.jit(flow.gini)
    np.testing.assert_allclose(gini(x, np.ones(x.shape, bool)), expected, rtol=1e-4)
    np.testing.assert_allclose(gini(60 * x[:, ::-1], np.ones(x.shape, bool)), expected, rtol=1e-4)


def test_gradients_are_differences(x64):
    way, time = jnp.asarray(WAY[:, :40], float) + 0.013, jnp.asarray(TIME[:40], float)
    mask = jnp.asarray(ALL[:, :40])

    @jax.jit
    def total(way):
        found = flow.passages(way, time, mask=mask, station=83.0)
        seconds, both = flow.travel_times(way, time, mask=mask, start=21.0, end=83.0)
        return jnp.sum(found.headway * found.time) + flow.gini(seconds + found.time, both)

    slope = jax.jit(jax.grad(total))(way)
    for at in [(0, 16), (0, 17), (1, 20), (1, 21), (0, 4), (0, 5)]:
        step = jnp.zeros_like(way).at[at].set(1e-6)
        assert slope[at] == pytest.approx(float(total(way + step) - total(way - step)) / 2e-6, abs=1e-5)
