"""Recorded drives as missions, on a made-up recording of a straight road."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from experiments.common import recordings
from tests.experiments.test_recorded import recording
from urbanjax.drivers import ConstantVelocity, IdmDriver
from urbanjax.evaluation.batch import Job, case_of, outcomes
from urbanjax.evaluation.missions.recorded import recorded_mission
from urbanjax.evaluation.recorded.planning_problem import Goal, PlanningProblem, Region
from urbanjax.evaluation.recorded.scenes import prepare, problems
from urbanjax.roadmap.builders import straight
from urbanjax.roadmap.builders.specs import RoadStyle
from urbanjax.roadmap.corridor import CorridorParams
from urbanjax.rollout import LoopParams
from urbanjax.sim.signals import SignalCycle
from urbanjax.types import RoadUser, ScenarioError, SignalState

LOOP = LoopParams(driver=ConstantVelocity())
STOP_LINES = 40.0, 85.0  # m, of the left and the right lane, both of signal 0
RED, YELLOW, GREEN = (int(state) for state in (SignalState.RED, SignalState.YELLOW, SignalState.GREEN))


def signalled(graph):
    lines = np.zeros(np.shape(graph.stop_line), np.float32)
    lines[:2, 0] = STOP_LINES
    has = lines > 0
    return graph.replace(n_signals=1, signal=jnp.zeros(has.shape, jnp.int32), has_signal=has, stop_line=lines)


def by_program(mission, *cycles):
    return recorded_mission(dataclasses.replace(mission.scene, cycles=cycles))


@pytest.fixture(scope="module")
def graph():
    return signalled(straight(2, 600.0, style=RoadStyle(lane_width=3.5, speed_limit=14.0, section=150.0)))


@pytest.fixture(scope="module")
def recorded():
    rows = [
        ("ego", 60.0, 0.0, 10.0, 0, 40),
        ("blocked", 20.0, 3.5, 10.0, 5, 40),
        ("blocks", 40.0, 3.5, 9.0, 5, 40),
        ("walks", 90.0, -2.0, 1.0, 0, 40),
        ("rides", 120.0, 0.0, 4.0, 0, 40),
    ]
    return dataclasses.replace(recording(rows), kind=("car", "car", "truck", "pedestrian", "bicycle"))


@pytest.fixture(scope="module")
def mission(graph, recorded):
    scene = prepare("made_up", graph, recording=recorded, params=CorridorParams(spacing=2.0), shortest=3.0)
    return recorded_mission(scene)


def posed(graph, recorded, *goals):
    """One problem for each goal: from x = 30 m in the right lane at 10 m/s."""
    tasks = [PlanningProblem(k, (30.0, 0.0), 0.0, 10.0, 0.0, (goal,)) for k, goal in enumerate(goals)]
    return problems("made_up", graph, recording=recorded, tasks=tasks, params=CorridorParams(spacing=1.0))


def test_motor_vehicles_are_replaced_and_the_others_are_what_they_are(mission):
    assert [start.name for start in mission.scene.starts] == ["ego", "blocked", "blocks"]
    kind = case_of(LOOP, Job(mission, 0), traffic="replay").start.replay.kind
    assert kind.tolist() == [0, 0, 0, RoadUser.PEDESTRIAN, RoadUser.CYCLIST]
    with pytest.raises(ScenarioError, match="made_up has the drives 0 to 2, not 3"):
        case_of(LOOP, Job(mission, 3), traffic="replay")


def test_a_case_asks_for_most_of_the_recorded_way_in_its_time(mission):
    case = case_of(LOOP, Job(mission, 1), traffic="replay")
    start = mission.scene.starts[1]
    assert (start.first, start.steps) == (5, 36)
    np.testing.assert_allclose(case.limit, 3.5, rtol=1e-6)
    begins = 25.0 - case.corridor.position[0, 0]  # m, station of where it is first seen
    np.testing.assert_allclose(case.goal, begins + 0.8 * 35.0, rtol=1e-4)
    np.testing.assert_allclose(case.start.time, 0.5, rtol=1e-6)
    np.testing.assert_allclose(case.vehicle.length, 4.8, rtol=1e-6)
    np.testing.assert_allclose(case.start.ego.position, [25.0 - 0.3 * 4.8, 3.5], atol=1e-3)  # of the rear axle


def test_all_others_are_there_when_they_were(mission):
    for k, there in enumerate(([0, 1, 1, 1, 1], [1, 0, 1, 1, 1], [1, 1, 0, 1, 1])):
        start = case_of(LOOP, Job(mission, k), traffic="replay").start
        assert start.replay.valid[10].tolist() == there
        assert start.replay.valid[2].tolist() == [there[0], 0, 0, 1, 1]  # two come later
        np.testing.assert_allclose(start.replay.position[10, 3:], [[91.0, -2.0], [124.0, 0.0]], atol=1e-4)
        assert not start.traffic.valid.any()


def test_drives_of_a_recording_are_judged_like_any_other(mission):
    jobs = [Job(mission, k) for k in range(3)]
    kept = list(outcomes(LOOP, jobs, traffic="replay", chunk=4))
    for k, one in enumerate(kept):
        assert (one.row["mission"], one.row["seed"], one.row["traffic"]) == ("made_up", k, "replay")
        assert one.row["success"]
        np.testing.assert_allclose(one.row["way_m"], 0.8 * 10.0 * (4.0, 3.5, 3.5)[k] * (1, 1, 0.9)[k], atol=1.0)
        np.testing.assert_allclose(one.row["nuplan_progress"], 1.0, atol=1e-5)


@pytest.mark.parametrize(("offset", "red"), [(0.0, 1), (0.1, 0), (-5.0, 0), (7.2, 1)])
def test_a_stop_line_is_crossed_at_what_the_program_shows_at_that_time_of_the_record(mission, offset, red):
    """Front bumpers are just before their lines at 2.2 s (ego) and at 1.7 s of the record (blocked, from 0.5 s on)."""
    cycle = SignalCycle((1.65, 0.1, 0.45, 0.1, 4.9), (GREEN, RED, GREEN, RED, YELLOW), offset)
    found = list(outcomes(LOOP, [Job(by_program(mission, cycle), k) for k in range(2)], traffic="replay", chunk=4))
    assert [one.row["competition_red_light"] for one in found] == [red, red]
    assert [one.row["success"] for one in found] == [not red, not red]


def test_who_drives_sees_the_signals_of_the_program(mission):
    loop = LoopParams(driver=IdmDriver())
    for state, crosses in ((RED, False), (GREEN, True)):
        cycle = SignalCycle((1.0, 50.0), (YELLOW, state), offset=-2.0)
        (one,) = outcomes(loop, [Job(by_program(mission, cycle), 0)], traffic="replay", chunk=4)
        assert (one.row["way_m"] > STOP_LINES[1] - 62.4) == crosses
        assert one.row["competition_red_light"] == 0


def test_signals_with_and_without_a_program_are_counted_by_scene(mission):
    assert recordings.signals([mission.scene, by_program(mission, SignalCycle((1.0,), (RED,))).scene]) == {
        "scene": ["made_up", "made_up"],
        "signals by the map's program": [0, 1],
        "signals shown green": [1, 0],
    }


def test_a_problem_is_solved_by_a_drive_that_reaches_all_that_its_goal_names(graph, recorded):
    here, left = (Region((50.0, y), length=6.0, width=2.0) for y in (0.0, 3.5))
    goals = {
        "passed at once": (Goal(regions=(here,), time=(0.0, 15.0)), True),
        "in time": (Goal(regions=(here,), time=(1.8, 2.2), speed=(9.0, 11.0), heading=(-0.1, 0.1)), True),
        "either": (Goal(regions=(left, here)), True),
        "left again": (Goal(regions=(here,), time=(3.0, 4.0)), False),
        "in the other lane": (Goal(regions=(left,), time=(0.0, 4.0)), False),
        "too fast": (Goal(regions=(here,), speed=(0.0, 5.0)), False),
        "turned": (Goal(regions=(here,), heading=(3.0, 3.2)), False),
    }
    found = recorded_mission(posed(graph, recorded, *(goal for goal, _ in goals.values())))
    rows = [one.row for one in outcomes(LOOP, [Job(found, k) for k in range(7)], traffic="replay", chunk=8)]
    assert {name: bool(row["competition_reached"]) for name, row in zip(goals, rows, strict=True)} == {
        name: reached for name, (_, reached) in goals.items()
    }
    assert [row["success"] for row in rows] == [True] * 3 + [False] * 4
    np.testing.assert_allclose([row["way_m"] for row in rows[:3]], [17.0, 18.0, 17.0], atol=0.05)
    np.testing.assert_allclose([row["nuplan_progress"] for row in rows[:2]], 1.0, atol=0.01)
    np.testing.assert_allclose(found.goal[0], 47.0, atol=1.01)  # the route is sampled every metre


@pytest.mark.parametrize(
    ("goal", "message"),
    [
        (Goal(time=(0.0, 3.0)), "problem 0: a goal names no place"),
        (Goal(lanes=(7,)), "problem 0: a goal names lanes that cannot be driven"),
        (Goal(regions=(Region((50.0, 90.0), radius=2.0),)), "problem 0: no goal is a station of the route"),
        (Goal(links=(1,), time=(31.0, 40.0)), "problem 0: its goals begin after 30 s"),
    ],
)
def test_a_goal_that_is_no_station_of_the_route_is_refused_with_the_reason(graph, recorded, goal, message):
    with pytest.raises(ScenarioError, match=rf"made_up: {message}.*; leave the recording out"):
        recorded_mission(posed(graph, recorded, goal))


def test_a_drive_without_an_end_lasts_as_long_as_its_record(mission):
    endless = recorded_mission(mission.scene, endless=True)
    (one,) = outcomes(LOOP, [Job(endless, 0)], traffic="replay", chunk=4)
    np.testing.assert_allclose([one.row["way_m"], one.row["duration_s"]], [40.0, 4.0], rtol=1e-3)
