import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.sim import agents
from urbanjax.sim.mobil import incentive
from urbanjax.vehicle.following import highway_idm, idm_acceleration

from .conftest import LIMIT, x_of

SLOW = {"x": 80.0, "lane": 1, "speed": 4.0, "desired_speed": 4.0 / LIMIT}
FAST = {"x": 50.0, "lane": 1, "speed": 10.0, "changes": True}


def test_changes_lane_behind_a_slow_vehicle_and_passes(road):
    states = road.roll(road.world(road.traffic(SLOW, FAST)), 200)
    lanes = np.array([int(state.traffic.link[1]) % 2 for state in states])
    assert lanes[0] == 1
    assert lanes[-1] == 0
    assert np.abs(np.diff(lanes)).sum() == 1
    x = x_of(states[-1].traffic)
    assert x[1] > x[0] + 20
    assert states[-1].traffic.speed[1] > 12


def test_lane_change_is_smooth_and_takes_three_seconds(road):
    states = road.roll(road.world(road.traffic(SLOW, FAST)), 200)
    boxes = [agents.objects(road.lanes, state.traffic, params=road.params.traffic) for state in states]
    y = np.array([box.position[1, 1] for box in boxes])
    assert np.abs(np.diff(y)).max() < 0.25
    assert np.abs(np.diff(y, 2)).max() < 0.03
    under_way = (y > 0.01) & (y < 3.49)
    assert 22 < under_way.sum() < 31
    heading = np.array([box.heading[1] for box in boxes])
    x = np.array([box.position[1, 0] for box in boxes])
    slope = np.gradient(y) / np.gradient(x)
    np.testing.assert_allclose(np.tan(heading)[2:-2], slope[2:-2], atol=0.01)


def test_both_lanes_are_occupied_during_the_change(road):
    states = road.roll(road.world(road.traffic(SLOW, FAST)), 120)
    changing = [state.traffic for state in states if float(state.traffic.moved[1]) < 1]
    assert len(changing) > 20
    assert all(bool(traffic.has_other[1]) and int(traffic.other[1]) % 2 == 1 for traffic in changing)
    # In the lane being left it still keeps its distance.
    assert min(x_of(traffic)[0] - x_of(traffic)[1] for traffic in changing if float(traffic.offset[1]) < -1.6) > 4.5


def test_without_advantage_nobody_changes(road):
    vehicles = [{"x": 20.0 + 45.0 * i, "lane": i % 2, "speed": 12.0, "changes": True} for i in range(8)]
    states = road.roll(road.world(road.traffic(*vehicles)), 100)
    assert all(np.all(np.asarray(state.traffic.moved) == 1) for state in states)


@pytest.mark.parametrize("beside", [-12.0, -3.0, 0.0, 3.0, 6.0])
def test_never_into_an_occupied_gap(road, beside):
    neighbour = {"x": FAST["x"] + beside, "lane": 0, "speed": 10.0, "desired_speed": 10.0 / LIMIT}
    states = road.roll(road.world(road.traffic(SLOW, FAST, neighbour)), 60)
    for state in states:
        if int(state.traffic.link[1]) % 2 == 0:
            x = x_of(state.traffic)
            assert abs(x[1] - x[2]) > 4.5 + 2.0
    traffic = states[10].traffic
    assert int(traffic.link[1]) % 2 == 1


def test_does_not_cut_in_before_the_ego(road):
    world = road.world(road.traffic(SLOW, FAST), ego_x=42.0, ego_y=3.5, ego_speed=14.0, ego_link=0)
    free = road.roll(road.world(road.traffic(SLOW, FAST)), 12)[-1].traffic
    assert int(free.link[1]) == 0
    held = road.roll(world, 12)[-1].traffic
    assert int(held.link[1]) == 1


def test_two_vehicles_do_not_follow_each_other_across(road):
    """One leaves the left lane late; another must not enter beside it while its body is still there."""
    leaving = {"x": 50.0, "lane": 1, "speed": 10.0, "moved": 0.3, "offset_from": 3.5, "offset": 2.9}
    leaving |= {"other": 0, "other_station": 50.0, "has_other": True}
    states = road.roll(road.world(road.traffic(leaving, SLOW | {"x": 75.0}, FAST | {"x": 52.0, "lane": 1})), 1)
    assert int(states[-1].traffic.link[2]) == 1


def test_decision_equals_highway_env():
    behavior = pytest.importorskip("highway_env.vehicle.behavior")
    road_module = pytest.importorskip("highway_env.road.road")

    class Driver(behavior.IDMVehicle):
        """Its defaults, written out: highway-env's intersections change them for the whole process."""

        DISTANCE_WANTED, TIME_WANTED, DELTA = 10.0, 1.5, 4.0
        COMFORT_ACC_MAX, COMFORT_ACC_MIN = 3.0, -5.0

    rng = np.random.default_rng(5)
    network = road_module.RoadNetwork.straight_road_network(2, speed_limit=30)
    params, agreed, changed = highway_idm(), 0, 0
    with jax.enable_x64(True):
        for _ in range(150):
            road = road_module.Road(network, np_random=np.random.RandomState(0))
            x = {"ego": 100.0, "old_leader": 100 + rng.uniform(8, 80), "old_follower": 100 - rng.uniform(8, 60)}
            x |= {"new_leader": 100 + rng.uniform(6, 80), "new_follower": 100 - rng.uniform(6, 80)}
            speed = {name: rng.uniform(10, 28) for name in x}
            made = {}
            for name in x:
                lane = 4.0 if name.startswith("new") else 0.0
                made[name] = Driver(road, [x[name], lane], 0.0, speed[name], target_speed=28.0)
                road.vehicles.append(made[name])
            made["ego"].POLITENESS = 0.4

            def acceleration(who, front, x=x, speed=speed):
                own, wanted, gap, ahead = (jnp.asarray(v) for v in (speed[who], 28.0, x[front] - x[who], speed[front]))
                return idm_acceleration(own, wanted, gap=gap, front_speed=ahead, params=params)

            imposed = acceleration("new_follower", "ego")
            gain = incentive(
                acceleration("ego", "new_leader") - acceleration("ego", "old_leader"),
                imposed - acceleration("new_follower", "new_leader"),
                old_follower_gain=acceleration("old_follower", "old_leader") - acceleration("old_follower", "ego"),
                politeness=jnp.asarray(0.4),
            )
            ours = bool((imposed >= -2.0) & (gain >= 0.2))
            agreed += ours == made["ego"].mobil(("0", "1", 1))
            changed += ours
    assert agreed == 150
    assert 20 < changed < 130
