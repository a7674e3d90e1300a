"""Even clocks and stations: known curves, the circle of headings, gaps, standstills, counts that add up."""

import numpy as np
import pytest

from tests.io.logs.formats import drive
from urbanjax.io import logs
from urbanjax.io.logs import LogError
from urbanjax.io.logs.resample import by_length, by_time


def log_of(time, position, **others):
    return logs.from_arrays("car", time, position=position, **others)


def arc(n=200, **others):
    time, position, speed, heading = drive(n, **others)
    return log_of(time, position, speed=speed, heading=heading)


def test_a_log_on_a_clock_has_its_multiples_as_times_and_linear_values():
    rng = np.random.default_rng(0)
    time = np.sort(rng.uniform(3.33, 20, 300))
    log = log_of(time, np.stack([2 * time + 1, -time], -1), speed=3 * time, heading=0.1 * time)
    found = by_time(log, 0.25)
    np.testing.assert_array_equal(found.log.time, 0.25 * found.index)
    assert found.log.time[0] == 0.25 * np.ceil(time[0] / 0.25)
    assert found.log.time[-1] == 0.25 * np.floor(time[-1] / 0.25)
    np.testing.assert_allclose(found.log.position[:, 0], 2 * found.log.time + 1)
    np.testing.assert_allclose(found.log.speed, 3 * found.log.time)
    np.testing.assert_allclose(found.log.heading, 0.1 * found.log.time)
    assert found.piece.max() == 0
    np.testing.assert_array_equal(found.log.rows, np.searchsorted(time, found.log.time, side="right") - 1)


def test_a_log_that_is_on_the_clock_stays_as_it_is():
    log = arc()
    found = by_time(log, 0.1)
    np.testing.assert_allclose(found.log.time, log.time, atol=1e-9)
    np.testing.assert_allclose(found.log.position, log.position, atol=1e-9)
    assert found.log.n == log.n


def test_heading_takes_the_short_way_round():
    log = log_of(np.arange(4.0), np.arange(8.0).reshape(4, 2), heading=np.radians([170, -170, 170, 190]))
    found = np.degrees(by_time(log, 0.5).log.heading)
    np.testing.assert_allclose(np.mod(found, 360), [170, 180, 190, 180, 170, 180, 190], atol=1e-9)
    assert np.all(np.abs(found) <= 180 + 1e-9)


def test_an_absent_speed_stays_absent():
    log = arc(20)
    log.speed[5] = log.heading[7] = np.nan
    found = by_time(log, 0.05).log
    assert 1 <= np.isnan(found.speed).sum() <= 4
    assert 1 <= np.isnan(found.heading).sum() <= 4
    assert np.isfinite(found.position).all()


@pytest.mark.parametrize("along", [False, True])
def test_nothing_is_made_up_in_a_gap(along):
    log = arc()
    whole = log.take(np.array([k for k in range(200) if not 50 <= k < 90 and not 120 <= k < 122]))
    found = by_length(whole, 0.5) if along else by_time(whole, 0.04)
    assert (found.gaps, found.gap_time) == (1, pytest.approx(4.1))
    assert found.piece.max() == 1
    first, second = found.pieces()
    assert first.time[-1] == pytest.approx(log.time[49], abs=0.05)
    assert second.time[0] == pytest.approx(log.time[90], abs=0.05)
    assert first.n + second.n == found.log.n
    ahead = by_length(whole, 0.5, longest_gap=5.0) if along else by_time(whole, 0.04, longest_gap=5.0)
    assert ahead.piece.max() == 0
    assert ahead.gaps == 0


def test_a_log_along_its_way_has_even_steps():
    log = arc()
    found = by_length(log, 2.0)
    turn = np.arctan2(found.log.position[:, 0], 80 - found.log.position[:, 1])
    np.testing.assert_allclose(80 * np.unwrap(turn), 2.0 * np.arange(found.log.n), atol=0.02)
    np.testing.assert_allclose(found.log.time, 5 + 2.0 * np.arange(found.log.n) / 12, atol=2e-3)
    np.testing.assert_allclose(found.station, 2.0 * np.arange(found.log.n), rtol=1e-3, atol=1e-9)
    assert found.log.n == 1 + int(199 * 1.2 / 2.0)


def test_standing_stretches_take_no_room():
    time, position, _, _ = drive(200)
    noise = np.random.default_rng(0).normal(0, 0.02, (600, 2))
    stops = np.concatenate([position[:100], position[99] + noise, position[100:]])
    found = by_length(log_of(0.1 * np.arange(800), stops), 1.0)
    plain = by_length(log_of(time, position), 1.0)
    assert found.standing == pytest.approx(600, abs=2)
    assert abs(found.log.n - plain.log.n) <= 1
    np.testing.assert_allclose(found.log.position[:200], plain.log.position[:200], atol=0.3)
    assert found.piece.max() == 0  # standing is no gap
    rough = by_length(log_of(0.1 * np.arange(800), stops), 1.0, standing=0.0)
    assert rough.log.n > found.log.n + 10  # noise counts as way there


def test_raw_samples_only():
    at = np.arange(0, 30, 0.5)
    known = np.round(np.stack([40 * np.sin(at / 9), 40 * np.cos(at / 7)], -1), 1)
    time = np.sort(np.concatenate([at, np.random.default_rng(5).uniform(0, at[-1], 240)]))
    log = log_of(time, np.stack([np.interp(time, at, axis) for axis in known.T], -1))
    found = by_time(log, 0.5, raw_only=True)
    assert found.interpolated == 240
    np.testing.assert_allclose(found.log.position, known[: found.log.n], atol=1e-9)


def test_single_samples_between_gaps_are_counted():
    log = arc()
    found = by_time(log.take(np.array([*range(50), 100, *range(150, 200)])), 0.1)
    assert (found.single, found.gaps, found.piece.max()) == (1, 2, 1)


@pytest.mark.parametrize("wrong", [0.0, -1.0, np.nan, np.inf])
def test_steps_that_are_none_are_refused(wrong):
    for resample in (by_time, by_length):
        with pytest.raises(LogError, match="must be positive"):
            resample(arc(), wrong)
        with pytest.raises(LogError, match="longest_gap must be positive"):
            resample(arc(), 0.1, longest_gap=wrong)


def test_steps_that_give_too_many_samples_or_too_few_are_refused():
    for resample in (by_time, by_length):
        with pytest.raises(LogError, match="take larger steps"):
            resample(arc(), 1e-7)
        with pytest.raises(LogError, match="no piece has two samples"):
            resample(arc(), 1e5)
