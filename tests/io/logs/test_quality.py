"""Frozen, stuck, interpolated and coarse logs, each made so that the answer is known."""

import numpy as np
import pytest

from tests.io.logs.formats import drive
from urbanjax.io import logs
from urbanjax.io.logs.quality import coarseness, quality
from urbanjax.io.logs.sampling import raw, resolution, roughness


def log_of(time, position, **others):
    return logs.from_arrays("car", time, position=position, **others)


def test_a_clean_log_has_nothing_against_it():
    time, position, speed, _ = drive(200)
    q = quality(log_of(time, position, speed=speed))
    assert q.verdict == "nothing against it"
    assert (q.samples, q.repeated, q.tied, q.interpolated, q.frozen, q.dead_speed) == (200, 0, 0, 0, False, False)
    assert q.length == pytest.approx(199 * 1.2, rel=1e-3)
    assert (q.duration, q.period, q.longest_gap) == pytest.approx((19.9, 0.1, 0.1))


@pytest.mark.parametrize("speed", [None, 0.0, 30.0])
def test_a_log_that_never_moves_is_frozen_even_with_noise_and_one_outlier(speed):
    time, position, _, _ = drive(200)
    still = np.full((200, 2), [483.0, -7.4]) + np.random.default_rng(1).normal(0, 1e-3, (200, 2))
    still[77] += 40.0
    q = quality(log_of(time, still, speed=None if speed is None else np.full(200, speed)))
    assert q.frozen
    assert q.verdict.startswith("frozen: no movement in 20 s")
    assert ("said to reach 30.0 m/s" in q.verdict) == (speed == 30.0)
    assert not quality(log_of(time, position)).frozen


@pytest.mark.parametrize("stated", [True, False])
def test_stuck_stretches_and_ties_are_counted(stated):
    time, position, speed, _ = drive(200)
    position[50:60] = position[50]  # nine repeats over 0.9 s
    position[120:123] = position[120]
    position[170] = position[30]  # a tie that no neighbour in time shows
    q = quality(log_of(time, position, speed=speed if stated else None))
    assert (q.repeated, q.repeated_moving) == (11, 11)
    assert (q.tied, q.places) == (15, 3)
    assert q.longest_stuck == pytest.approx(0.9)
    assert "11 samples repeat the position before, 11 of them while it moves (up to 0.9 s" in q.verdict


def test_repeats_at_a_standstill_are_no_fault():
    time, position, speed, _ = drive(200)
    position[100:], speed[100:] = position[100], 0.0
    q = quality(log_of(time, position, speed=speed))
    assert (q.repeated, q.repeated_moving) == (99, 0)
    assert q.verdict == "nothing against it"


def test_a_dead_speed_is_told():
    time, position, speed, _ = drive(200)
    q = quality(log_of(time, position, speed=0 * speed))
    assert q.dead_speed
    assert "stated speed is 0" in q.verdict


def interpolated(period=0.5, grid=0.0, digits=15):
    """Samples [n], raw ones every `period` and two more between each two, to so many digits, and which are raw."""
    rng = np.random.default_rng(4)
    at = np.arange(0, 60, period)
    known = np.stack([40 * np.sin(at / 9), 40 * np.cos(at / 7)], -1) + rng.normal(0, 0.1, (len(at), 2))
    known = np.round(known / grid) * grid if grid else known
    time = np.sort(np.concatenate([at, rng.uniform(at[:-1], at[1:]), rng.uniform(at[:-1], at[1:])]))
    position = np.stack([np.interp(time, at, axis) for axis in known.T], -1).round(digits)
    return log_of(time, position), np.isin(time, at)


@pytest.mark.parametrize(("grid", "digits"), [(0.0, 15), (0.1, 15), (0.1, 3), (0.5, 2), (0.5, 15), (0.3048, 15)])
def test_samples_interpolated_between_raw_ones_are_found(grid, digits):
    log, truth = interpolated(grid=grid, digits=digits)
    found = raw(log)
    assert np.mean(found == truth) > (0.98 if grid else 0.97)
    assert not (truth & ~found)[1:-1].any() or not grid
    q = quality(log)
    assert q.interpolated == (~found).sum()
    assert "interpolated" in q.verdict


@pytest.mark.parametrize("grid", [0.001, 0.01, 0.1, 0.5, 1.0, 0.3048])
def test_the_grid_of_coarse_positions_is_found(grid):
    _, position, _, _ = drive(200)
    coarse = np.round(position / grid) * grid
    assert resolution(coarse) == pytest.approx(grid)
    assert resolution(coarse * np.array([1, 0])) == pytest.approx(grid)  # along a straight road


def test_positions_in_double_precision_lie_on_no_grid():
    _, position, _, _ = drive(200)
    assert resolution(position) == 0.0
    assert raw(log_of(*drive(200)[:2])).all()


def test_roughness_is_the_noise_of_the_positions_at_any_rate():
    for noise in (0.02, 0.3):
        for dt in (0.1, 0.4):
            time, position, _, _ = drive(2000, dt=dt, radius=500.0)
            time = time + np.random.default_rng(3).uniform(-0.3, 0.3, 2000) * dt
            turn = 12.0 * (time - 5) / 500
            position = 500 * np.stack([np.sin(turn), 1 - np.cos(turn)], -1)
            noisy = position + np.random.default_rng(2).normal(0, noise, position.shape)
            # The median of a length whose two coordinates have the standard deviation `noise`.
            assert roughness(log_of(time, noisy)) == pytest.approx(noise * np.sqrt(2 * np.log(2)), rel=0.1)


def test_coarser_logs_stand_out():
    time, position, _, _ = drive(300)
    rng = np.random.default_rng(0)
    noise = [0.1, 0.1, 0.1, 0.3]
    found = [quality(log_of(time, position + rng.normal(0, s, position.shape))) for s in noise]
    found.append(quality(log_of(time, np.zeros((300, 2)))))
    ratio = coarseness(found)
    np.testing.assert_allclose(ratio[:4], [1, 1, 1, 3], rtol=0.15)
    assert np.isnan(ratio[4])
