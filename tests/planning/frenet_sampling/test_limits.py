"""Which limits each Frenet candidate breaks, from its points and the boxes of others."""

import jax.numpy as jnp
import numpy as np

from tests.planning.frenet_sampling.helpers import VEHICLE, cars, curved, each, fan_of, grid, line_of, plan_of, state
from urbanjax.planning.frenet_sampling import limits
from urbanjax.planning.frenet_sampling.choice import FrenetParams
from urbanjax.planning.frenet_sampling.limits import FRENET_LIMITS
from urbanjax.planning.frenet_sampling.motion import EndGrid
from urbanjax.types import as_arrays


def limits_of(fan, params):
    """Which limits each candidate breaks, point by point; of the first four."""
    sharpest, limits = np.tan(VEHICLE.max_steering) / VEHICLE.wheelbase, params.limits
    found = []
    for heading, speed, curvature, acceleration in np.moveaxis(each(fan.values)[2:], 0, 1):
        engine = limits.max_acceleration * np.minimum(1, limits.switching_speed / np.maximum(speed, 1e-9))
        found.append(
            [
                np.any(np.abs(curvature[2:-2]) > sharpest),
                np.any(np.abs(np.diff(curvature)) / 0.1 > limits.max_curvature_rate),
                np.any((acceleration > engine) | (acceleration < -limits.max_acceleration)),
                np.any(np.abs(np.diff(heading)) / 0.1 > sharpest * speed[1:] + 1e-5),
            ]
        )
    return np.array(found).T


def test_limits_are_those_of_the_points():
    # From slow and aside to far and fast, so that each limit rejects some and not all.
    begin, line = state((10.0, 2.0, 0.0), (0.0, 1.2, 0.0)), line_of(curved)
    params = as_arrays(FrenetParams(grid=EndGrid((-2.0, 0.0, 2.0), (2.0, 8.0), (0.0,), (1.0, 2.0), n_times=26)))
    params = params.replace(limits=params.limits.replace(switching_speed=jnp.asarray(3.0)))
    reasons = np.asarray(plan_of(line, begin, params=params).reasons)
    wanted = limits_of(fan_of(line, begin, params.grid), params)
    np.testing.assert_array_equal(reasons[:4].reshape(4, -1), wanted)
    assert np.all(wanted.any(1) & ~wanted.all(1))
    stronger = params.replace(limits=params.limits.replace(switching_speed=jnp.asarray(100.0)))
    other = np.asarray(plan_of(line, begin, params=stronger).reasons)
    assert other[2].sum() < reasons[2].sum()
    assert not reasons[4:].any()


def test_reversing_and_leaving_the_line_are_reasons():
    short, back = line_of(curved, length=32.0), FRENET_LIMITS.index("reverse")
    plan = plan_of(short)
    covered = np.asarray(fan_of(short, state(), grid()).along.station).max(axis=-1)
    expected = np.broadcast_to(covered > 32, plan.cost.shape)
    np.testing.assert_array_equal(plan.reasons[FRENET_LIMITS.index("reference")], expected)
    assert expected.any()
    assert not expected.all()
    hard_brake = plan_of(line_of(curved), state((10.0, 1.0, -8.0)))
    assert np.asarray(hard_brake.reasons[back]).any()
    assert not np.asarray(plan.reasons[back]).any()


def touches(poses, other, velocity):
    """Whether a point of the ego's box is ever in one of the first two of the others; poses [3, T]."""
    x, y, heading = poses[:, :, None]
    share = np.linspace(-0.5, 0.5, 41)
    ahead, aside = (v.ravel() for v in np.meshgrid(share * VEHICLE.length, share * VEHICLE.width))
    ahead = ahead + float(VEHICLE.centre_offset)
    px = x + np.cos(heading) * ahead - np.sin(heading) * aside - velocity * 0.1 * np.arange(x.size)[:, None]
    py = y + np.sin(heading) * ahead + np.cos(heading) * aside
    for (bx, by), angle in zip(np.asarray(other.position[:2, 0]), np.asarray(other.heading[:2, 0]), strict=True):
        c, s = np.cos(angle), np.sin(angle)
        along, across = (px - bx) * c + (py - by) * s, (py - by) * c - (px - bx) * s
        if np.any((np.abs(along) < 2.25) & (np.abs(across) < 0.9)):
            return True
    return False


def test_collisions_are_overlaps_of_the_boxes():
    line = line_of(curved)
    other = cars([(28.0, 4.0, 0.5), (20.0, -3.0, -0.3), (15.0, 0.0, 0.0)], velocity=1.0)  # the last one does not count
    fan, plan = fan_of(line, state(), grid()), plan_of(line, prediction=other)
    gap = np.asarray(limits.clearance(fan, other, vehicle=VEHICLE, grid=grid())).ravel()
    hits = np.asarray(plan.reasons[FRENET_LIMITS.index("collision")]).ravel()
    np.testing.assert_array_equal(hits, gap < 0)
    for i, poses in enumerate(np.moveaxis(each(fan.values)[:3], 0, 1)):
        if abs(gap[i]) > 0.1:  # the points within a box are that far apart
            assert touches(poses, other, velocity=1.0) == hits[i]
    assert hits.any()
    assert not hits.all()
