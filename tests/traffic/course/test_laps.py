"""Laps, crossings and areas: known answers, and what jitter, gaps and padding must not change."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.traffic import crossing
from urbanjax.traffic.course import areas as named
from urbanjax.traffic.course.laps import LapParams, laps
from urbanjax.types.errors import TrafficError

LENGTH = 100.0
PARAMS = LapParams(capacity=5)
find = jax.jit(laps, static_argnames="closed")
cross = jax.jit(crossing.crossings)
T = 120
TIME = 0.5 * np.arange(T)
WAY = 90 + 8.0 * TIME  # lines at 1.25 s, and every 12.5 s from there
ALL = np.ones(T, bool)


def drive(way=WAY, mask=ALL, params=PARAMS, **options):
    return find(
        np.float32(way) % np.float32(LENGTH), np.float32(TIME), mask=mask, length=LENGTH, params=params, **options
    )


def test_even_driving_has_even_laps():
    found = drive()
    np.testing.assert_allclose(found.way, WAY, rtol=1e-5)
    np.testing.assert_array_equal(found.lap, np.floor(WAY / LENGTH))
    np.testing.assert_array_equal(found.complete, [False, True, True, True, True])
    np.testing.assert_allclose(found.time[1:], 12.5, rtol=1e-5)
    np.testing.assert_allclose(found.start[1:], 1.25 + 12.5 * np.arange(4), rtol=1e-5)
    assert found.count == 5


def test_a_lap_begins_and_ends_with_the_series_only_where_that_is_at_the_line():
    whole = np.linspace(0, 100, T)
    assert drive(whole).complete.tolist() == [True, False, False, False, False]
    assert drive(whole).time[0] == pytest.approx(TIME[-1])
    assert not drive(np.linspace(0.4, 99.6, T)).complete.any()
    near = drive(np.linspace(0.4, 99.6, T), params=LapParams(capacity=5, tolerance=0.5))
    assert near.complete[0]


def test_standing_and_jitter_on_the_line_and_backing_over_it_begin_no_lap():
    jitter = 1.2 * np.sin(np.arange(T) * 1.7)
    standing = np.where(TIME < 20, 60 + 2.0 * TIME, np.where(TIME < 40, 100 + jitter, 100 + 2.0 * (TIME - 40)))
    found = drive(standing)
    assert found.lap[-1] == 1
    assert np.all(np.diff(found.lap) >= 0)
    assert 38 <= found.end[0] <= 40.5
    assert np.all(drive(np.where(TIME < 55, 99.5 + jitter, 99)).lap == 0)
    out = np.where(TIME < 20, 5 - TIME, np.where(TIME < 30, -15, -15 + 4.0 * (TIME - 30)))
    found = drive(out)
    np.testing.assert_array_equal(found.lap, np.where(out < 100, 0, 1))
    assert not found.complete.any(), "lap 0 had begun before the series did"
    over = np.where(TIME < 20, 80 + 2 * TIME, np.where(TIME < 40, 120 - 1.5 * (TIME - 20), 90 + 2 * (TIME - 40)))
    assert drive(over).end[0] == pytest.approx(10, abs=0.01)
    assert drive(over).lap[-1] == 1


def test_missing_samples_and_padding_change_nothing_else():
    mask = ALL.copy()
    mask[[0, 1, 30, 31, 32, 80]] = False
    way = np.where(mask, WAY, np.nan)
    found, plain = drive(way, mask), drive()
    np.testing.assert_allclose(found.time, plain.time, rtol=1e-4)
    np.testing.assert_array_equal(found.lap[mask], plain.lap[mask])
    assert np.isfinite(found.way).all()
    nothing = drive(way, np.zeros(T, bool))
    assert not nothing.complete.any()
    assert np.all(nothing.way == 0)


def test_an_open_line_is_driven_once():
    found = find(np.float32(-10 + 4 * TIME), np.float32(TIME), mask=ALL, length=LENGTH, params=PARAMS, closed=False)
    assert found.complete.tolist() == [True]
    assert found.time[0] == pytest.approx(25, rel=1e-5)


def test_the_count_tells_of_laps_beyond_the_capacity():
    found = drive(params=LapParams(capacity=2))
    assert found.count == 5
    assert found.time.shape == (2,)


def test_a_station_is_crossed_where_the_straight_piece_meets_it_and_gradients_say_so(x64):
    time, way = jnp.array([0.0, 1.0, 2.0, 4.0]), jnp.array([0.0, 3.0, 9.0, 13.0])
    mask, stations = jnp.ones(4, bool), jnp.array([6.0, 10.0, 12.9, 20.0])
    found = cross(way, time, mask=mask, stations=stations, margin=1.0)
    np.testing.assert_array_equal(found.valid, [True, True, True, False])
    np.testing.assert_array_equal(found.sample, [2, 3, 3, 4])
    np.testing.assert_allclose(found.time, [1.5, 2.5, 3.95, 0])

    def total(way, time):
        return jnp.sum(cross(way, time, mask=mask, stations=stations, margin=1.0).time)

    slope = jax.jit(jax.grad(total, (0, 1)))(way, time)
    for i in range(4):
        step = jnp.zeros(4).at[i].set(1e-6)
        assert slope[0][i] == pytest.approx(float(total(way + step, time) - total(way - step, time)) / 2e-6, abs=1e-6)
        assert slope[1][i] == pytest.approx(float(total(way, time + step) - total(way, time - step)) / 2e-6, abs=1e-6)
    still = jax.grad(total, (0, 1))(jnp.full(4, 6.0), time)
    assert np.isfinite(still).all()


def test_a_batch_of_vehicles_equals_the_vehicles():
    ways = jnp.asarray(np.float32(np.stack([WAY, 20 + 3 * TIME]) % LENGTH))
    together = jax.jit(
        jax.vmap(lambda s: laps(s, jnp.asarray(np.float32(TIME)), mask=jnp.asarray(ALL), length=LENGTH, params=PARAMS))
    )(ways)
    np.testing.assert_allclose(together.time[0], drive().time, rtol=1e-5)
    np.testing.assert_allclose(together.time[1], drive(20 + 3 * TIME).time, rtol=1e-5)


AREAS = named.areas([("finish", 95.0, 10.0), ("curve", 10.0, 40.0), ("straight", 50.0, 95.0)], LENGTH)


def test_samples_are_in_their_areas_and_the_intervals_are_half_open():
    station = jnp.array([0.0, 9.9, 10.0, 39.9, 40.0, 45.0, 50.0, 95.0, 99.9])
    index, some = named.index(AREAS, station)
    np.testing.assert_array_equal(index[some], [0, 0, 1, 1, 2, 0, 0])
    np.testing.assert_array_equal(some, [1, 1, 1, 1, 0, 0, 1, 1, 1])


def test_selections_part_the_samples_of_the_areas_by_lap():
    found = drive()
    chosen = jax.jit(named.selection)(AREAS, found, mask=ALL, length=LENGTH)
    assert chosen.shape == (5, 3, T)
    held = named.inside(AREAS, jnp.asarray(np.float32(WAY % LENGTH)))
    np.testing.assert_array_equal(chosen.sum(0), held & (found.lap < 5)[None])
    at = int(np.flatnonzero((WAY >= 310) & (WAY < 340))[0])
    assert chosen[3, 1, at]


def test_passages_of_areas_take_their_length_over_the_speed():
    found = drive()
    seconds, seen = jax.jit(named.passages)(AREAS, found, time=np.float32(TIME), mask=ALL, length=LENGTH, params=PARAMS)
    np.testing.assert_allclose(seconds[1:4], np.tile([15 / 8, 30 / 8, 45 / 8], (3, 1)), rtol=1e-4)
    assert seen[1:4].all()
    assert seen[0].tolist() == [True, False, False]


@pytest.mark.parametrize(
    ("rows", "word"),
    [
        ([("a", 0.0, 10.0), ("a", 20.0, 30.0)], "name of its own"),
        ([("a", 0.0, 100.5)], "'a': end is 100.5 m"),
        ([("b", float("nan"), 10.0)], "'b': start is nan"),
        ([("c", 5.0, 5.0)], "'c' is empty"),
    ],
)
def test_areas_that_make_no_sense_are_refused_by_name(rows, word):
    with pytest.raises(TrafficError, match=word):
        named.areas(rows, LENGTH)
