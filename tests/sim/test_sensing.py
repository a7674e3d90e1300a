"""What an ego is told that has to find its pose: nothing of where it is, and others as they are seen from it."""

import jax
import jax.numpy as jnp
import jaxlie
import numpy as np
import pytest

from urbanjax.localization.types import Localization
from urbanjax.sim import world as worlds
from urbanjax.sim.lidar import LidarParams
from urbanjax.sim.scenery.scenery import furnish
from urbanjax.sim.sensing import Sensing, WheelErrors
from urbanjax.types import as_arrays

LIDAR = as_arrays(LidarParams(pattern="vlp_16", columns=64, nearby=16, layers=2))
EXACT = WheelErrors(1.0, 0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def look(road):
    """Observations of one world, with the pose given and with scans."""
    world = road.world(road.traffic({"lane": 1, "speed": 8.0, "x": 60.0}), ego_x=40.0, ego_speed=9.0, heading=0.1)
    params, surroundings = road.params.replace(lidar=LIDAR), furnish(road.lanes.graph, 1)

    @jax.jit
    def see(time, count, **more):
        sensing = Sensing(surroundings, jax.random.key(3), **more)
        now = world.replace(time=time, count=count)
        return worlds.observe(params, road.lanes, world=now, sensing=sensing)

    def at(time=0.0, count=0, **more):
        return see(jnp.asarray(time), jnp.asarray(count, jnp.int32), **as_arrays(more))

    return worlds.observe(params, road.lanes, world=world), at, world


def test_the_pose_is_not_told_and_others_are_where_they_are_seen(look):
    given, at, world = look
    seen = at()
    assert seen.pose is None
    assert int(seen.scan.valid.sum()) > 100
    ahead = np.asarray(given.objects.position)[0] - np.asarray(world.ego.position)
    turned = np.array([[np.cos(0.1), np.sin(0.1)], [-np.sin(0.1), np.cos(0.1)]]) @ ahead
    np.testing.assert_allclose(seen.objects.position[0], turned, atol=1e-4)
    np.testing.assert_allclose(seen.objects.heading[0], given.objects.heading[0] - 0.1, atol=1e-6)


def test_who_knows_the_pose_sees_others_where_they_are_and_who_errs_beside_himself(look):
    given, at, world = look
    seen, true = at(), world.ego.pose
    wrong = jaxlie.SE2.from_xy_theta(12.0, -5.0, 0.7) @ true
    for believed in (true, wrong):
        found = Localization(believed, jnp.eye(3), jnp.asarray(0)).in_world(seen).objects
        offset = believed.inverse().apply(found.position[0]) - true.inverse().apply(given.objects.position[0])
        np.testing.assert_allclose(offset, 0.0, atol=1e-4)
    known = Localization(wrong, jnp.eye(3), jnp.asarray(0)).in_world(given)
    np.testing.assert_array_equal(known.objects.position, given.objects.position)


def test_no_scan_arrives_while_it_is_silent(look):
    _, at, _ = look
    count = [int(at(time=t, silent=jnp.array([1.0, 3.0])).scan.valid.sum()) for t in (0.9, 1.0, 2.9, 3.0)]
    assert count[1] == count[2] == 0
    assert min(count[0], count[3]) > 100


def test_wheels_err_as_they_are_said_to(look):
    given, at, _ = look
    exact = at(wheels=EXACT).odometry
    np.testing.assert_array_equal(exact.speed, given.odometry.speed)
    np.testing.assert_array_equal(exact.yaw_rate, given.odometry.yaw_rate)
    biased = at(wheels=WheelErrors(1.01, 0.0, 0.02, 0.0)).odometry
    np.testing.assert_allclose(biased.speed, 1.01 * given.odometry.speed, rtol=1e-6)
    np.testing.assert_allclose(biased.yaw_rate, given.odometry.yaw_rate + 0.02, rtol=1e-5)
    noisy = [at(count=k, wheels=WheelErrors(1.0, 0.1, 0.0, 0.01)).odometry for k in range(40)]
    for name, size in (("speed", 0.1), ("yaw_rate", 0.01)):
        off = np.array([getattr(one, name) - getattr(given.odometry, name) for one in noisy])
        assert 0.6 * size < off.std() < 1.4 * size
        assert abs(off.mean()) < 0.6 * size


def test_wheels_that_stand_do_not_turn_back():
    speed, _ = WheelErrors(1.0, 0.5, 0.0, 0.0).on(
        jnp.zeros(50), jnp.zeros(50), keys=jax.random.split(jax.random.key(0))
    )
    assert float(speed.min()) == 0.0
