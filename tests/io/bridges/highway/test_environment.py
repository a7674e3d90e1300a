"""Which environments of highway-env can be driven, and where they send their ego."""

import gymnasium
import pytest

from experiments.highway.study import HighwayStudy, drives
from urbanjax.io.bridges.highway.environment import drivable, make_idm, open_environment
from urbanjax.io.bridges.highway.episode import Idm, drive
from urbanjax.types import ConfigError

REFUSED = ("lane-keeping-v0", "parking-v0", "parking-ActionRepeat-v0", "parking-parked-v0")
GOALS = {
    "exit-v0": ("2", "exit"),
    "intersection-v0": ("il1", "o1"),
    "intersection-v1": ("il1", "o1"),
    "roundabout-v0": ("nx", "nxs"),
    "roundabout-generic-v1": ("nx", "nxs"),
    "u-turn-v0": ("c", "d"),
    "highway-v0": None,
    "racetrack-v1": None,
}


@pytest.mark.parametrize("name", [*REFUSED, "CartPole-v1", "higway-v0", "highway", "nowhere:highway-v0"])
def test_what_cannot_be_driven_is_refused_in_one_line(name):
    with pytest.raises(ConfigError, match=rf"'{name}'.*'envs'.* highway-v0, ") as refusal:
        open_environment(name)
    message = str(refusal.value)
    assert "\n" not in message
    assert not set(REFUSED) & set(message.replace(",", "").split())


def test_every_other_environment_is_driven():
    names = drivable()
    registered = [name for name, spec in gymnasium.registry.items() if "highway_env" in str(spec.entry_point)]
    assert sorted([*names, *REFUSED]) == sorted(registered)
    for name in names:
        env = open_environment(name)
        episode = drive(env, (name, "IDM"), driver=Idm(), seed=0, duration=0.2)
        assert episode.distance > 1.0
        assert episode.others.valid.shape[0] == 4


def test_a_study_names_what_it_cannot_drive_before_it_drives():
    with pytest.raises(ConfigError, match="'parking-v0'"):
        next(drives(HighwayStudy(envs=("highway-v0", "parking-v0"))))


@pytest.mark.parametrize(("name", "road"), GOALS.items())
def test_the_environment_says_where_to_go(name, road):
    env = open_environment(name)
    env.reset(seed=0)
    route = env.vehicle.route
    assert (route and route[-1][:2]) == road
    make_idm(env)
    assert env.vehicle.route == route


def test_a_destination_replaces_the_goal_and_must_be_reachable():
    for name, node in (("roundabout-v0", "wxr"), ("intersection-v0", "o3"), ("racetrack-v1", "e")):
        env = open_environment(name, destination=node)
        env.reset(seed=0)
        assert env.vehicle.route[-1][1] == node
    # No such node, nobody turns back there, and it lies behind.
    for name, node, others in (("intersection-v0", "o9", "o3"), ("intersection-v0", "o0", "o3"), ("exit-v0", "0", "3")):
        with pytest.raises(ConfigError, match=rf"'destination' '{node}' is no node.* {others}"):
            open_environment(name, destination=node)


def test_of_many_egos_one_is_driven_and_the_others_are_traffic():
    env = open_environment("intersection-multi-agent-v0")
    env.reset(seed=0)
    assert len(env.controlled_vehicles) == 1
    kinds = [type(vehicle).__name__ for vehicle in env.road.vehicles]
    assert kinds.count("RoutedVehicle") == 1
    assert set(kinds) == {"RoutedVehicle", "IDMVehicle"}


def test_traffic_does_not_depend_on_what_was_driven_before():
    from highway_env.vehicle.behavior import IDMVehicle

    seen = []
    for name in ("roundabout-v0", "intersection-v0", "roundabout-v0"):
        open_environment(name)
        seen.append((IDMVehicle.DISTANCE_WANTED, IDMVehicle.COMFORT_ACC_MAX, IDMVehicle.COMFORT_ACC_MIN))
    assert seen == [(10.0, 3.0, -5.0), (7, 6, -3), (10.0, 3.0, -5.0)]
