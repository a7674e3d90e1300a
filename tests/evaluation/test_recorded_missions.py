"""Recorded drives as missions, on a made-up recording of a straight road."""

import dataclasses

import numpy as np
import pytest

from tests.experiments.test_recorded import recording
from urbanjax.drivers import ConstantVelocity
from urbanjax.evaluation.batch import Job, case_of, outcomes
from urbanjax.evaluation.missions.recorded import recorded_mission
from urbanjax.evaluation.recorded.scenes import prepare
from urbanjax.roadmap.builders import straight
from urbanjax.roadmap.builders.specs import RoadStyle
from urbanjax.roadmap.corridor import CorridorParams
from urbanjax.rollout import LoopParams
from urbanjax.types import RoadUser, ScenarioError

LOOP = LoopParams(driver=ConstantVelocity())


@pytest.fixture(scope="module")
def mission():
    graph = straight(2, 600.0, style=RoadStyle(lane_width=3.5, speed_limit=14.0, section=150.0))
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
