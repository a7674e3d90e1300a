"""Arcs, their inverse, and a sweep with the motion taken out."""

import jax
import jax.numpy as jnp
import jaxlie
import numpy as np
import pytest

from urbanjax.localization import motion
from urbanjax.types import Odometry


def odometry(speed: float, yaw_rate: float) -> Odometry:
    zero = jnp.zeros(())
    return Odometry(zero + speed, zero, zero, zero + yaw_rate)


@pytest.mark.parametrize("yaw_rate", [0.0, 1e-4, 0.02, -0.7, 3.0])
@pytest.mark.parametrize("time", [-0.1, 0.0, 0.05, 2.0])
def test_arc_is_a_circle(yaw_rate, time):
    x, y, heading = motion.arc(jnp.asarray(8.0), jnp.asarray(yaw_rate), time=jnp.asarray(time))
    radius, turn = np.float64(8.0) / (yaw_rate or 1.0), yaw_rate * time
    expected = (radius * np.sin(turn), 2 * radius * np.sin(turn / 2) ** 2) if yaw_rate else (8.0 * time, 0.0)
    np.testing.assert_allclose([x, y], expected, atol=2e-6, rtol=1e-6)
    np.testing.assert_allclose(heading, turn, atol=1e-6)


def test_arc_has_a_derivative_on_the_straight():
    slope = jax.grad(lambda w: motion.arc(jnp.asarray(8.0), w, time=jnp.asarray(2.0))[1])(0.0)
    np.testing.assert_allclose(slope, 8.0 * 2.0**2 / 2, rtol=1e-4)


def test_a_sweep_without_its_motion_stands_on_the_wall(street):
    """Seen in a fast turn, de-skewed points lie on the footprints of what is there."""
    noiseless = street.sensor.replace(noise=jnp.zeros(()), dropout=jnp.zeros(()))
    ego = street.ego(80.0, speed=15.0)
    yaw_rate = jnp.asarray(0.6)
    scan = street._sweep(
        noiseless, street.surroundings, vehicles=None, ego=ego, yaw_rate=yaw_rate, key=jax.random.key(0)
    )
    turn = jaxlie.SO3.identity()
    mount = jaxlie.SE3.from_rotation_and_translation(turn, jnp.array([street.sensor.x, 0.0, 1.57]))
    moving = odometry(15.0, 0.6)
    points = motion.deskew(scan, mount, odometry=moving)[scan.valid.reshape(-1)]
    raw = motion.deskew(scan, mount, odometry=odometry(0.0, 0.0))[scan.valid.reshape(-1)]
    x, y = np.asarray(points[:, 0]) + 80.0, np.asarray(points[:, 1])
    assert np.abs(np.asarray(points - raw)).max() > 0.5

    def outside(x, y):
        """Distance of points from the nearest footprint's boundary."""
        s = jax.device_get(street.surroundings)
        away = np.stack([x, y], -1)[:, None] - s.centre[None]
        cos, sin = np.cos(s.heading), np.sin(s.heading)
        along = np.abs(away[..., 0] * cos + away[..., 1] * sin) - s.half[:, 0]
        across = np.abs(away[..., 1] * cos - away[..., 0] * sin) - s.half[:, 1]
        inner = np.maximum(along, across)
        gap = np.where(inner > 0, np.hypot(np.maximum(along, 0), np.maximum(across, 0)), -inner)
        return np.where(s.valid[None], gap, np.inf).min(1)

    above = np.asarray(points[:, 2]) > -0.2
    # All but those on roofs, which lie inside a footprint.
    assert (outside(x[above], y[above]) < 5e-3).mean() > 0.95
    raw_x, raw_y = np.asarray(raw[:, 0]) + 80.0, np.asarray(raw[:, 1])
    assert (outside(raw_x[above], raw_y[above]) < 5e-3).mean() < 0.2


def test_planar_and_spatial_are_inverse():
    pose = jaxlie.SE2.from_xy_theta(3.0, -2.0, 2.5)
    back = motion.planar(motion.spatial(pose))
    np.testing.assert_allclose(back.parameters(), pose.parameters(), atol=1e-6)
