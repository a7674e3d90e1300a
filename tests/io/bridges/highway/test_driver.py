"""Our stack at the wheel in highway-env: it sees what is there, drives, and compiles nothing on the way."""

import jax
import numpy as np
import pytest

from urbanjax.io.bridges.highway.driver import HIGHWAY_STACK, DriverParams, StackDriver
from urbanjax.io.bridges.highway.environment import open_environment
from urbanjax.io.bridges.highway.episode import drive
from urbanjax.io.bridges.highway.network import read_network
from urbanjax.io.bridges.highway.route import Destination, ahead, course_to, shared_ground
from urbanjax.types import RouteError, as_arrays


@pytest.fixture(scope="module")
def environments():
    return {name: open_environment(name) for name in ("merge-v1", "two-way-v0", "racetrack-v1")}


@pytest.fixture(scope="module")
def driver():
    return StackDriver(HIGHWAY_STACK, DriverParams())


def test_observation_is_the_rear_axle_and_the_nearest_vehicles_with_y_up(environments, driver):
    env = environments["merge-v1"]
    env.reset(seed=3)
    driver.command = (0.5, 0.1)
    env.vehicle.heading = -0.2
    seen = driver.observe(env)
    ego = env.vehicle
    expected = ego.position * [1.0, -1.0] - 2.5 * np.array([np.cos(0.2), np.sin(0.2)])
    assert np.asarray(seen.pose.translation()) == pytest.approx(expected, abs=1e-4)
    assert float(seen.pose.rotation().as_radians()) == pytest.approx(0.2, abs=1e-6)
    assert float(seen.odometry.steering) == pytest.approx(0.1)
    assert float(seen.odometry.speed) == pytest.approx(ego.speed * np.cos(np.arctan(np.tan(0.1) / 2)))
    count = int(seen.objects.valid.sum())
    things = [*env.road.vehicles[1:], *env.road.objects]
    near = sorted(np.linalg.norm(thing.position - ego.position) for thing in things)
    found = np.linalg.norm(seen.objects.position[:count] - ego.position * [1.0, -1.0], axis=-1)
    assert found == pytest.approx([distance for distance in near if distance < 150.0], rel=1e-5)


def test_odometry_predicts_how_highway_env_moves_the_rear_axle(environments, driver):
    env = environments["merge-v1"]
    env.reset(seed=0)
    driver.command = (0.0, 0.3)
    env.vehicle.speed = 6.0
    env.vehicle.action = {"steering": -0.3, "acceleration": 0.0}
    before = driver.observe(env)
    env.vehicle.step(1e-3)
    after = driver.observe(env)
    # The pose is single precision, so the step is judged by its exact twin in double precision.
    heading = float(before.pose.rotation().as_radians())
    turned = float(after.pose.rotation().as_radians()) - heading
    assert turned == pytest.approx(float(before.odometry.yaw_rate) * 1e-3, abs=2e-6)
    assert float(before.odometry.yaw_rate) == pytest.approx(float(before.odometry.speed) * np.tan(0.3) / 5.0, rel=1e-6)


def test_the_road_ahead_ends_in_any_lane_and_laps_where_it_closes(environments):
    given = DriverParams()  # what the driver takes, so that its programs serve here
    params = as_arrays(given.corridor)
    for name, goals, laps in (("merge-v1", 2, 1), ("two-way-v0", 1, 1), ("racetrack-v1", 2, 5)):
        env = environments[name]
        env.reset(seed=0)
        graph, keys = read_network(env.road.network, buckets=True)
        start = keys.index(("a", "b", 1, 0))
        destination = ahead(graph, start, reach=given.reach)
        assert len(destination.goals) == goals
        assert destination.laps == laps
        course = course_to(graph, start, destination=destination, params=params)
        assert int(course.corridor.lane_link[0, course.corridor.route_lane]) == start
        change = np.asarray(course.corridor.change)[:, course.corridor.route_lane]
        assert change.all() == (name != "racetrack-v1")
        assert shared_ground(graph).sum() == (2 if name == "two-way-v0" else 0)
    with pytest.raises(RouteError, match="none of the goals"):
        course_to(graph, start, destination=Destination([0], np.full((1, 32), np.inf), 1), params=params)


def test_networks_of_one_bucket_share_their_shapes(environments):
    shapes = set()
    for env in environments.values():
        env.reset(seed=0)
        graph, _ = read_network(env.road.network, buckets=True)
        shapes.add(str(jax.tree.map(lambda x: (x.shape, x.dtype), graph)))
    assert len(shapes) == 1


@pytest.fixture
def compilations():
    """Names of the programs compiled since the test began."""
    found = []

    def count(name, seconds, **_):
        if name.endswith("backend_compile_duration"):
            found.append(name)

    jax.monitoring.register_event_duration_secs_listener(count)
    yield found
    jax.monitoring.unregister_event_duration_listener(count)


def test_it_drives_on_the_road_and_compiles_once_for_all_of_them(environments, driver, compilations):
    for name, env in environments.items():
        episode = drive(env, (name, "stack"), driver=driver, seed=0, duration=1.0)
        assert len(driver.step_seconds) == 15
        assert not episode.collision
        assert episode.on_road.all()
        assert episode.distance > 0.8 * episode.speed.min()
        assert np.abs(np.diff(episode.speed)).max() < 6.0 / 15 + 1e-6
        before = len(compilations)
        drive(env, (name, "stack"), driver=driver, seed=1, duration=0.5)
        assert len(compilations) == before  # another seed, another graph: nothing new
    assert compilations


@pytest.mark.parametrize(
    ("name", "last"),
    [
        ("intersection-v0", ("il1", "o1")),
        ("roundabout-v0", ("nxs", "nxr")),
        ("roundabout-generic-v0", ("nxs", "nxr")),
    ],
)
def test_it_goes_where_the_environment_sends_it_and_on_to_the_end_of_the_road(driver, name, last):
    env = open_environment(name)
    env.reset(seed=0)
    driver.plan(env)
    corridor = driver.course.corridor
    way = np.asarray(corridor.lane_link)[:, corridor.route_lane]
    assert driver.keys[way[0]][:2] == env.vehicle.lane_index[:2]
    assert driver.keys[way[-1]][:2] == last
    ends = env.road.network.graph[last[0]][last[1]]
    end = np.asarray(driver.graph.centre)[way[-1], -1] * [1.0, -1.0]
    assert min(np.linalg.norm(lane.position(lane.length, 0.0) - end) for lane in ends) < 0.1


def test_vehicles_come_and_go_while_it_drives(driver):
    env = open_environment("intersection-v0")
    episode = drive(env, ("intersection-v0", "stack"), driver=driver, seed=1, duration=1.0)
    assert len(driver.step_seconds) == 15
    assert episode.others.valid.shape[0] == 16
    assert not episode.others.valid[0].all()
    assert episode.on_road.all()
    assert not episode.arrived
