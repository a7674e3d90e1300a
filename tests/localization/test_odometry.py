"""Odometry between scans: a known way, keyframes as they are needed, and a new beginning where nothing fits."""

import functools

import jax
import jax.numpy as jnp
import jaxlie
import numpy as np
import pytest

from urbanjax.localization import lidar, motion, odometry


@pytest.fixture(scope="module")
def run(street):
    step = jax.jit(functools.partial(odometry.step, street.localizer.odometry))

    def along(places, seed=0, motions=None):
        """Odometers and states along places [T, 3] (x, y, heading), predicted by `motions` or not at all."""
        state = odometry.init(street.localizer.odometry, street.localizer.preprocess.downsample.capacity)
        found, states = [], []
        for k, (x, y, heading) in enumerate(places):
            seen = street.observe(street.ego(x, y, heading, speed=0.0), seed + k)
            guess = jaxlie.SE3.identity() if motions is None else motions[k]
            state, odometer = step(state, street._cloud(street.localizer, seen), guess)
            found.append(odometer)
            states.append(state)
        return found, states

    return along


def test_the_way_of_a_slow_curve_is_found_without_prediction(run):
    places = [(60.0 + 0.4 * k, 0.02 * k**2 / 2, 0.05 * k) for k in range(12)]
    found, states = run(places)
    start = jaxlie.SE2.from_xy_theta(*map(jnp.asarray, places[0]))
    for place, state in zip(places, states, strict=True):
        expected = start.inverse() @ jaxlie.SE2.from_xy_theta(*map(jnp.asarray, place))
        there = motion.planar(odometry.travelled(state))
        away = expected.inverse() @ there
        assert np.linalg.norm(away.translation()) < 0.12
        assert abs(float(away.rotation().as_radians())) < 0.01
    assert all(bool(one.tracked) for one in found[1:])


def test_keyframes_come_with_the_way(run, street):
    """2 m apart: of 12 scans along 4.4 m the first and those past 2 and 4 m join the local map."""
    _, states = run([(60.0 + 0.4 * k, 0.0, 0.0) for k in range(12)])
    capacity = street.localizer.preprocess.downsample.capacity
    frames = [int(jnp.any(state.valid.reshape(-1, capacity), axis=1).sum()) for state in states]
    assert frames == [1] * 6 + [2] * 6
    standing = run([(60.0, 0.0, 0.0)] * 4, seed=50)[1][-1]
    assert int(jnp.any(standing.valid.reshape(-1, capacity), axis=1).sum()) == 1


def test_a_jump_is_not_believed_and_begins_a_new_local_map(run, street):
    found, states = run([(60.0, 0.0, 0.0), (60.2, 0.0, 0.0), (110.0, 0.0, 0.0), (110.2, 0.0, 0.0)])
    assert [bool(one.tracked) for one in found] == [False, True, False, True]
    np.testing.assert_allclose(found[2].T_before_after.translation(), 0.0, atol=1e-4)
    capacity = street.localizer.preprocess.downsample.capacity
    assert int(jnp.any(states[3].valid.reshape(-1, capacity), axis=1).sum()) == 1
    np.testing.assert_allclose(found[3].T_before_after.translation()[:2], [0.2, 0.0], atol=0.08)


def test_an_empty_scan_carries_the_prediction_on(run, street):
    moved = motion.travelled(street.observe(street.ego(60.0), 0).odometry, 0.1)
    state = run([(60.0, 0.0, 0.0)])[1][-1]
    empty = lidar.PointCloud(
        *(
            jnp.zeros_like(x)
            for x in vars(street._cloud(street.localizer, street.observe(street.ego(60.0), 0))).values()
        )
    )
    following, odometer = odometry.step(street.localizer.odometry, state, empty, moved)
    np.testing.assert_allclose(odometer.T_before_after.parameters(), moved.parameters(), atol=1e-5)
    np.testing.assert_array_equal(following.valid, state.valid)
