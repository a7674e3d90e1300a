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
from urbanjax.evaluation.recorded.scenes import prepare
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
def mission():
    graph = signalled(straight(2, 600.0, style=RoadStyle(lane_width=3.5, speed_limit=14.0, section=150.0)))
    rows = [
        ("ego", 60.0, 0.0, 10.0, 0, 40),
        ("blocked", 20.0, 3.5, 10.0, 5, 40),
        ("blocks", 40.0, 3.5, 9.0, 5, 40),
        ("walks", 90.0, -2.0, 1.0, 0, 40),
        ("rides", 120.0, 0.0, 4.0, 0, 40),
    ]
    made = dataclasses.replace(recording(rows), kind=("car", "car", "truck", "pedestrian", "bicycle"))
    return recorded_mission(prepare("made_up", graph, recording=made, params=CorridorParams(spacing=2.0), shortest=3.0))


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
    np.testing.assert_allclose(case.goal - case.corridor.station[0], case.goal, rtol=1e-6)
    np.testing.assert_allclose(case.start.time, 0.5, rtol=1e-6)
    np.testing.assert_allclose(case.vehicle.length, 4.8, rtol=1e-6)
    np.testing.assert_allclose(case.start.ego.position, [25.0 - 0.3 * 4.8, 3.5], atol=1e-3)  # of the rear axle


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
