"""Drives in highway-env: equal traffic for every driver, honest distances and times to collision."""

import numpy as np
import pytest

from urbanjax.io.bridges.highway.environment import ACCELERATION, STEERING, action_of, make_idm, open_environment
from urbanjax.io.bridges.highway.episode import Episode, Idm, drive
from urbanjax.io.bridges.highway.measure import time_to_collision
from urbanjax.types import Objects


def sample(ego, others, steps=1, gone=()):
    """A drive that stands still at one moment. Each vehicle: x, y (m), heading (rad), speed (m/s).

    Those in `gone` were there at the first moment only.
    """
    rows = np.array([[*other, 5.0, 2.0] for other in others], float).reshape(-1, 6)
    table = np.repeat(rows[None], steps, axis=0)
    table[1:, list(gone)] = np.nan
    columns = (table[..., i] for i in range(2, 6))
    x, y, heading, speed = ego
    return Episode(
        env="",
        driver="",
        seed=0,
        nominal=1.0,
        time=np.arange(steps) / 15,
        position=np.full((steps, 2), (x, y), float),
        heading=np.full(steps, heading, float),
        speed=np.full(steps, speed, float),
        on_road=np.full(steps, True),
        others=Objects(table[..., :2], *columns, valid=np.isfinite(table[..., 0])),
        collision=False,
        step_seconds=[],
        frames=[],
    )


@pytest.mark.parametrize(
    ("ego", "other", "expected"),
    [
        ((0, 0, 0, 20), (45, 0, 0, 10), 4.0),
        ((0, 0, 0, 20), (45, 0, np.pi, 20), 1.0),
        ((0, 0, 0, 20), (45, 1.9, 0, 10), 4.0),
        ((0, 0, 0, 20), (45, 2.1, 0, 10), np.inf),
        ((0, 0, 0, 10), (45, 0, 0, 10), np.inf),
        ((0, 0, 0, 10), (-45, 0, 0, 20), 4.0),
        ((0, 0, 0, 10), (3, 0, 0, 10), 0.0),
        ((0, 0, 0, 10), (23.5, -23.5, np.pi / 2, 10), 2.0),
    ],
)
def test_time_to_collision_of_known_meetings(ego, other, expected):
    assert time_to_collision(sample(ego, [other]), steps=4) == pytest.approx([expected], abs=1e-4)


def test_time_to_collision_without_others_is_infinite():
    assert time_to_collision(sample((0, 0, 0, 20), [], steps=3)).tolist() == [np.inf] * 3


def test_time_to_collision_forgets_who_is_gone():
    ahead, behind = (45, 0, 0, 10), (-45, 0, 0, 30)
    ttc = time_to_collision(sample((0, 0, 0, 20), [ahead, behind], steps=3, gone=[0]))
    assert ttc == pytest.approx([4.0] * 3, abs=1e-4)
    ttc = time_to_collision(sample((0, 0, 0, 20), [ahead, behind], steps=3, gone=[0, 1]))
    assert ttc.tolist() == [pytest.approx(4.0, abs=1e-4), np.inf, np.inf]


class Remover(Idm):
    """Takes the vehicle behind the first of the others out of the traffic after ten steps."""

    def start(self, env):
        super().start(env)
        self.steps = 0

    def act(self, env):
        self.steps += 1
        if self.steps == 10:
            del env.road.vehicles[1]


def test_vehicles_that_come_and_go_keep_their_columns():
    env = open_environment("intersection-v0")
    episode = drive(env, ("intersection-v0", "IDM"), driver=Remover(), seed=1, duration=1.0)
    others, there = episode.others, episode.others.valid
    assert there[:, 1].tolist() == [True] * 10 + [False] * 6
    assert np.isnan(others.position[~there]).all()
    assert not there[0].all()  # some came
    assert there[:, [0, 2]].all()
    steps = np.linalg.norm(np.diff(others.position, axis=0), axis=-1)[there[1:] & there[:-1]]
    assert 0.0 < steps.max() < 1.0  # m: nobody jumps
    assert not np.isnan(time_to_collision(episode)).any()


def test_actions_reach_the_vehicle_in_its_own_units():
    env = open_environment("highway-v0", vehicles_count=0)
    env.reset(seed=0)
    env.step(action_of(-2.0, 0.1))
    assert env.vehicle.action["acceleration"] == pytest.approx(-2.0)
    assert env.vehicle.action["steering"] == pytest.approx(-0.1)  # left is up here, down there
    env.step(action_of(-100.0, 9.0))
    assert env.vehicle.action["acceleration"] == pytest.approx(ACCELERATION[0])
    assert env.vehicle.action["steering"] == pytest.approx(STEERING[0])


@pytest.mark.parametrize("name", ["highway-v0", "merge-v1", "two-way-v0", "racetrack-v1"])
def test_every_driver_meets_the_same_traffic(name):
    def scene(env):
        return [(type(v).__name__, *v.position, v.heading, v.speed, v.lane_index) for v in env.road.vehicles]

    env = open_environment(name)
    env.reset(seed=4)
    ego, place = env.vehicle, env.road.vehicles.index(env.vehicle)
    before = scene(env)
    env.reset(seed=5)
    assert scene(env)[1:] != before[1:]
    env.reset(seed=4)
    make_idm(env)
    after = scene(env)
    assert after[place][0] == "IDMVehicle"
    assert after[place][1:] == before[place][1:]
    del after[place], before[place]
    assert after == before
    assert env.vehicle is not ego


class Straight:
    """Drives on as it is, on the traffic's own lane."""

    def __init__(self, acceleration):
        self.acceleration, self.step_seconds = acceleration, []

    def start(self, env):
        pass

    def act(self, env):
        return action_of(self.acceleration, 0.0)


def test_a_drive_without_traffic_covers_what_physics_says():
    env = open_environment("highway-v0", vehicles_count=0)
    episode = drive(env, ("highway-v0", "straight"), driver=Straight(-1.0), seed=0, duration=4.0)
    assert episode.time[-1] == pytest.approx(4.0)
    assert episode.speed[[0, -1]] == pytest.approx([25.0, 21.0])
    assert episode.distance == pytest.approx(25.0 * 4 - 8.0, abs=0.2)
    assert episode.mean_speed == pytest.approx(episode.distance / 4.0)
    assert episode.others.valid.shape == (61, 0)
    assert episode.arrived is None  # it goes nowhere in particular
    assert not episode.collision


def test_a_crash_ends_the_drive_and_costs_the_rest_of_its_distance():
    env = open_environment("two-way-v0")
    episode = drive(env, ("two-way-v0", "straight"), driver=Straight(3.0), seed=0, duration=20.0)
    assert episode.collision
    assert episode.time[-1] < 20.0
    assert episode.nominal == 20.0
    assert time_to_collision(episode)[-1] < 0.1
    assert episode.mean_speed < episode.distance / episode.time[-1]


def test_the_end_of_the_road_ends_the_drive_and_its_nominal_time():
    env = open_environment("two-way-v0")
    env.reset(seed=0)
    env.road.vehicles[1:] = []
    env.reset = lambda seed: None
    episode = drive(env, ("two-way-v0", "straight"), driver=Straight(0.0), seed=0, duration=60.0)
    assert episode.nominal == pytest.approx(episode.time[-1])
    assert episode.position[-1, 0] == pytest.approx(800.0, abs=5.0)
    assert episode.mean_speed == pytest.approx(30.0, rel=1e-3)


def test_the_idm_ego_drives_and_pictures_show_it():
    env = open_environment("merge-v1")
    episode = drive(env, ("merge-v1", "idm"), driver=Idm(), seed=0, duration=2.0, frame_every=15)
    assert isinstance(episode, Episode)
    assert len(episode.frames) == 2
    assert episode.frames[0].ndim == 3
    assert episode.frames[0].std() > 5.0  # not a black picture
    assert not np.array_equal(*episode.frames)
    assert np.isfinite(episode.position).all()
    assert episode.on_road.all()
