"""A drive along a course keeps its limits, and what its wheels say leads along it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.course import course_between
from urbanjax.roadmap.builders import curve
from urbanjax.sim.scenarios import tour
from urbanjax.sim.scenarios.tour import TourParams
from urbanjax.sim.sensing import WheelErrors

EXACT = TourParams(wheels=WheelErrors(1.0, 0.0, 0.0, 0.0), vehicles=5, speed=15.0)


@pytest.fixture(scope="module")
def driven():
    graph = curve(40.0, n_lanes=2)
    return graph, tour.drive(jax.random.key(0), course_between(graph, 1, goal=1).corridor, params=EXACT)


def test_limits(driven):
    _, drive = driven
    speed, yaw_rate = np.asarray(drive.ego.speed), np.asarray(drive.yaw_rate)
    assert speed.max() <= 15.0 + 1e-4
    assert np.abs(speed * yaw_rate).max() < 1.15 * EXACT.lateral
    acceleration = np.diff(speed) / EXACT.period
    assert acceleration.max() < 1.05 * EXACT.acceleration
    assert acceleration.min() > -1.05 * EXACT.deceleration
    assert np.all(np.diff(drive.station) > 0)


def test_wheels_lead_along_the_way(driven):
    """Integrating speed and yaw rate gives the poses back."""
    _, drive = driven
    heading, position = float(drive.ego.heading[0]), np.asarray(drive.ego.position[0], float)
    speed, yaw_rate = np.asarray(drive.odometry.speed, float), np.asarray(drive.odometry.yaw_rate, float)
    for k in range(len(speed) - 1):
        turn = 0.5 * (yaw_rate[k] + yaw_rate[k + 1]) * EXACT.period
        way = 0.5 * (speed[k] + speed[k + 1]) * EXACT.period
        position += way * np.array([np.cos(heading + turn / 2), np.sin(heading + turn / 2)])
        heading += turn
    np.testing.assert_allclose(position, drive.ego.position[-1], atol=0.5)
    np.testing.assert_allclose(heading, drive.ego.heading[-1], atol=0.02)


def test_traffic_stays_around_and_off_the_own_lane(driven):
    _, drive = driven
    boxes, there = drive.vehicles, np.asarray(drive.vehicles.valid)
    away = np.asarray(boxes.position) - np.asarray(drive.ego.position)[:, None]
    assert there.any()
    assert np.linalg.norm(away, axis=-1)[there].max() < EXACT.traffic_reach + 10
    close = there & (np.linalg.norm(away, axis=-1) < 15)
    heading = np.asarray(drive.ego.heading)[:, None]
    aside = np.abs(np.cos(heading) * away[..., 1] - np.sin(heading) * away[..., 0])
    assert aside[close].min(initial=9.0) > 2.0


def test_noise_has_its_size():
    graph = curve(40.0, n_lanes=2)
    params = TourParams(wheels=WheelErrors(1.01, 0.05, 0.002, 0.003))
    drive = tour.drive(jax.random.key(1), course_between(graph, 1, goal=1).corridor, params=params)
    off = np.asarray(drive.odometry.speed - 1.01 * drive.ego.speed)
    assert abs(off.mean()) < 0.02
    assert 0.03 < off.std() < 0.07
    turn = np.asarray(drive.odometry.yaw_rate - drive.yaw_rate)
    assert abs(turn.mean() - 0.002) < 0.001
    assert jnp.isfinite(drive.odometry.steering).all()
