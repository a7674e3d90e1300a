import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.vehicle.following import (
    HeadwayParams,
    IDMParams,
    constant_headway_speed,
    desired_gap,
    free_acceleration,
    highway_idm,
    idm_acceleration,
)


def test_equals_highway_env():
    behavior = pytest.importorskip("highway_env.vehicle.behavior")
    road_module = pytest.importorskip("highway_env.road.road")

    class Driver(behavior.IDMVehicle):
        """Its defaults, written out: highway-env's intersections change them for the whole process."""

        DISTANCE_WANTED, TIME_WANTED, DELTA = 10.0, 1.5, 4.0
        COMFORT_ACC_MAX, COMFORT_ACC_MIN = 3.0, -5.0

    network = road_module.RoadNetwork.straight_road_network(1, speed_limit=30)
    road = road_module.Road(network, np_random=np.random.RandomState(0))
    rng = np.random.default_rng(1)
    with jax.enable_x64(True):
        for _ in range(200):
            speed, wanted, front = rng.uniform(0, 40), rng.uniform(1, 40), rng.uniform(0, 40)
            distance = rng.uniform(0.2, 150)
            ego = Driver(road, [10.0, 0.0], 0.0, speed, target_speed=wanted)
            leader = Driver(road, [10.0 + distance, 0.0], 0.0, front)
            limited = min(wanted, 30.0)
            v, v_0, gap, v_f = (jnp.asarray(x) for x in (speed, limited, distance, front))
            found = idm_acceleration(v, v_0, gap=gap, front_speed=v_f, params=highway_idm())
            wanted_gap = desired_gap(v, v_f, params=highway_idm())
            free = free_acceleration(v, v_0, params=highway_idm())
            np.testing.assert_allclose(found, ego.acceleration(ego, leader), rtol=1e-9, atol=1e-6)
            np.testing.assert_allclose(free, ego.acceleration(ego), atol=1e-6)
            np.testing.assert_allclose(wanted_gap, ego.desired_gap(ego, leader), atol=1e-6)


@pytest.mark.parametrize("speed", [0.0, 5.0, 12.0])
def test_equilibrium_gap_is_the_textbook_one(speed):
    with jax.enable_x64(True):
        params = IDMParams()
        gap = (params.jam_distance + speed * params.time_headway) / np.sqrt(1 - (speed / 14.0) ** 4)
        v, v_0, gap = (jnp.asarray(x) for x in (speed, 14.0, gap))
        np.testing.assert_allclose(idm_acceleration(v, v_0, gap=gap, front_speed=v, params=params), 0.0, atol=1e-9)


def test_free_road_and_touching():
    wide, touching = jnp.asarray(1e6), jnp.asarray(-1.0)
    ten, zero = jnp.asarray(10.0), jnp.asarray(0.0)
    assert abs(idm_acceleration(ten, ten, gap=wide, front_speed=ten, params=IDMParams())) < 1e-4
    assert idm_acceleration(ten, ten, gap=touching, front_speed=zero, params=IDMParams()) < -100


def test_gradient_is_finite_on_degenerate_input():
    def total(x, params):
        return idm_acceleration(x[0], x[1], gap=x[2], front_speed=x[3], params=params)

    for x in ([0.0, 0.0, 0.0, 0.0], [10.0, 0.0, 1e6, 0.0], [0.0, 14.0, -3.0, 5.0]):
        gradient, to_params = jax.grad(total, argnums=(0, 1))(jnp.asarray(x), IDMParams())
        assert np.all(np.isfinite(gradient))
        assert all(np.isfinite(leaf) for leaf in jax.tree.leaves(to_params))


def test_constant_headway_known_answers():
    params = HeadwayParams(time_headway=1.0, jam_distance=2.0, deceleration=2.0)

    def speed(v, gap, front, cap=20.0):
        v, gap, front, cap = (jnp.asarray(x) for x in (v, gap, front, cap))
        return float(constant_headway_speed(v, gap, front_speed=front, cap=cap, params=params))

    assert speed(10.0, 12.0, 10.0) == 10.0  # at the wanted gap: the front vehicle's speed
    assert speed(10.0, 1e6, 10.0) == 20.0  # free: the cap
    assert speed(10.0, 0.0, 0.0) == 0.0
    # One who stands is approached along v T + v^2 / 2 b = gap - s0.
    for v in (4.0, 8.0, 12.0):
        assert speed(v, 2.0 + v + v * v / 4, 0.0) == pytest.approx(v, rel=1e-5)
    # One who cuts in near, at equal speed, is let go ahead gently; one who is about to be hit is not.
    assert speed(10.0, 6.5, 10.0) == pytest.approx(10.0 - params.easing * params.lag, rel=1e-5)
    assert speed(10.0, 1.5, 4.0) < 5.0


@pytest.mark.parametrize("brakes", [2.0, 4.0])
def test_one_who_follows_does_not_run_into_one_who_brakes(brakes):
    """At the wanted gap, with the lag and the comfortable limits of the longitudinal control."""
    params, dt = HeadwayParams(), 0.1
    v = front = 13.0
    gap, a, least = params.jam_distance + params.time_headway * v, 0.0, np.inf
    for _ in range(150):
        front_next = max(front - brakes * dt, 0.0)
        args = (jnp.asarray(x) for x in (v, gap))
        wanted = float(
            constant_headway_speed(*args, front_speed=jnp.asarray(front), cap=jnp.asarray(14.0), params=params)
        )
        a = float(np.clip(np.clip((wanted - v) / 0.6, -4.0, 2.0), a - 0.8, a + 0.8))
        v_next = max(v + a * dt, 0.0)
        gap += (front + front_next - v - v_next) / 2 * dt
        v, front, least = v_next, front_next, min(least, gap)
    assert least > 0.5
    assert v < 0.1
