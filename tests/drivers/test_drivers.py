"""Plain drivers in the closed loop: each does what it is for, and no more."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.scenes import loop_params
from urbanjax import stack
from urbanjax.behavior.situation import closed_line
from urbanjax.course import course_between
from urbanjax.drivers import Blind, ConstantVelocity, IdmDriver, Standstill
from urbanjax.roadmap.builders import RoadStyle, straight
from urbanjax.rollout import rollout
from urbanjax.sim import lanes as tables
from urbanjax.sim.scenarios.scenario import ego_at, traffic, world
from urbanjax.types import ConfigError, Objects, Observation, Signals, SignalState, as_arrays

LIMIT, STEPS = 14.0, 120


@pytest.fixture(scope="module")
def road():
    graph = straight(2, 500.0, style=RoadStyle(lane_width=3.5, speed_limit=LIMIT))
    return course_between(graph, 1, goal=1), tables.from_graph(graph)


@pytest.fixture(scope="module")
def drive(road):
    """A function of the driver, the ego's speed and a vehicle ahead (station, speed; None: nobody): the log."""
    program = jax.jit(lambda params, start: rollout(params, *road, start, STEPS)[0])

    def run(driver, speed, ahead=None):
        params = as_arrays(loop_params().replace(driver=driver))
        station, pace = (0.0, 0.0) if ahead is None else ahead
        others = traffic(
            jnp.ones(1, jnp.int32), jnp.array([station]), speed=jnp.array([pace]), limit=LIMIT,
            params=params.sim.traffic, valid=jnp.array([ahead is not None]),
        )  # fmt: skip
        y = road[0].graph.centre[1, 0, 1]
        start = world(ego_at(jnp.asarray(20.0), y, speed=jnp.asarray(speed)), 1, vehicles=others)
        return jax.device_get(program(params, start))

    return run


def test_standstill_brakes_in_full_and_stands(drive):
    log = drive(Standstill(), 10.0)
    stop = 10.0 / 6.0  # s, at the vehicle's greatest deceleration
    assert log.ego.speed[int(10 * stop) + 2] == pytest.approx(0, abs=1e-3)
    np.testing.assert_allclose(log.ego.position[-1], log.ego.position[30], atol=1e-3)


def test_constant_velocity_goes_on(drive):
    log = drive(ConstantVelocity(), 10.0, ahead=(60.0, 0.0))
    np.testing.assert_allclose(log.ego.speed, 10.0, rtol=1e-5)
    assert log.ego.position[-1, 0] == pytest.approx(20.0 + 10.0 * 0.1 * (STEPS - 1), abs=0.1)


def test_idm_reaches_the_limit_in_the_middle_of_its_lane(drive):
    log = drive(IdmDriver(), 8.0)
    assert 0.9 * LIMIT < log.ego.speed[-1] <= LIMIT + 1e-3
    assert np.abs(log.offset).max() < 0.05
    assert np.all(np.diff(log.ego.speed) > -1e-3)


@pytest.mark.parametrize(("station", "pace", "gap"), [(90.0, 0.0, 2.0), (50.0, 6.0, None)])
def test_idm_keeps_its_distance(drive, station, pace, gap):
    log = drive(IdmDriver(), 10.0, ahead=(station, pace))
    lead = log.traffic.position[:, 0, 0] - log.centre[:, 0] - 0.5 * (log.traffic.length[:, 0] + 4.7)
    assert lead.min() > 1.5
    assert log.ego.speed[-1] == pytest.approx(pace, abs=0.4)
    idm = IdmDriver().following
    expected = gap or (idm.jam_distance + pace * idm.time_headway) / np.sqrt(1 - (pace / LIMIT) ** 4)
    assert lead[-1] == pytest.approx(expected, abs=1.0)


def test_blind_is_the_stack_that_is_shown_nobody(monkeypatch):
    seen = []
    monkeypatch.setattr(stack, "step", lambda *arguments: seen.append(arguments))
    ones = jnp.ones(3)
    objects = Objects(jnp.ones((3, 2)), ones, ones, ones, ones, jnp.ones(3, bool))
    driver, _ = loop_params().replace(driver=Blind(), period=0.2).handed_down()
    driver.step("course", "state", Observation(odometry="odometry", objects=objects, signals="signals"))
    ((params, course, state, observation),) = seen
    assert (params.period, params.vehicle, course, state) == (0.2, loop_params().vehicle, "course", "state")
    assert not observation.objects.valid.any()
    assert (observation.signals, observation.odometry) == ("signals", "odometry")


def test_idm_stops_at_a_line_whose_signal_is_not_green(road):
    course, _ = road
    line = course.corridor.replace(
        stop_station=jnp.array([80.0, 120.0]), stop_signal=jnp.array([0, 1]), has_stop=jnp.array([True, True])
    )
    look = jax.jit(closed_line)
    for shown, valid, expected in (
        ("GREEN", True, 70.0),
        ("RED", True, 30.0),
        ("YELLOW", True, 30.0),
        ("GREEN", False, 30.0),
    ):
        state = jnp.array([SignalState[shown], SignalState.RED])
        signals = Signals(state, jnp.zeros(2), jnp.array([valid, True]))
        station, exists = look(line, signals, front=jnp.asarray(50.0))
        assert (float(station) - 50.0, bool(exists)) == (expected, True)


def test_what_the_loop_hands_down_is_not_said_twice(road):
    params = loop_params()
    with pytest.raises(ConfigError, match=r"'driver\.period' is said twice"):
        params.replace(driver=IdmDriver(period=0.1)).handed_down()
