"""Found encounters are missions whose cases hold the numbers that were stated."""

import numpy as np
import pytest

from urbanjax.evaluation.missions.found import FoundScene, found_missions
from urbanjax.evaluation.missions.protocol import Drives
from urbanjax.sim.agents import TrafficParams
from urbanjax.sim.scenarios.encounter_families import FAMILIES, LIMIT
from urbanjax.types import ConfigError
from urbanjax.vehicle.params import VehicleParams


def cases(*scenes):
    missions = found_missions(scenes)
    return [one.case(k, others=TrafficParams(), vehicle=VehicleParams()) for one in missions for k in range(one.count)]


def test_missions_come_by_family():
    scenes = [FoundScene("cut_in", {}), FoundScene("crossing", {}), FoundScene("cut_in", {"moves_at": 1.5})]
    missions = found_missions(scenes)
    assert [(one.name, one.count) for one in missions] == [("found_cut_in", 2), ("found_crossing", 1)]
    assert all(isinstance(one, Drives) for one in missions)


def test_a_leader_stands_its_time_gap_ahead():
    (case,) = cases(FoundScene("braking_leader", {"ego_speed": 0.9, "time_gap": 1.1, "braking": 7.0}))
    vehicle, them = VehicleParams(), case.start.traffic
    front = case.start.ego.position[0] + vehicle.length - vehicle.rear_overhang
    assert them.station[0] - them.length[0] / 2 - front == pytest.approx(1.1 * 0.9 * LIMIT, abs=1e-3)
    assert case.start.ego.speed == pytest.approx(0.9 * LIMIT)
    assert case.start.script is not None
    assert case.start.script.braking[0] == 7.0


def test_ways_cross_when_the_numbers_say():
    (case,) = cases(FoundScene("crossing", {"ego_speed": 0.6, "other_speed": 1.0, "later": 0.0}))
    graph, them = case.lanes.graph, case.start.traffic
    ego = case.start.ego
    line = np.asarray(graph.centre[0], float)
    towards = (line[-1] - line[0]) / np.linalg.norm(line[-1] - line[0])
    place = line[0] + towards * float(them.station[0])
    front = np.asarray(ego.position) + 3.75 * np.array([np.cos(ego.heading), np.sin(ego.heading)])
    time = abs(front[1] - place[1]) / float(ego.speed)
    assert abs(place[0] - front[0]) / float(them.speed[0]) == pytest.approx(time, abs=0.01)


@pytest.mark.parametrize(
    ("scene", "said"),
    [
        (FoundScene("cut_out", {}), "cut_in"),
        (FoundScene("cut_in", {"gap": 1.0}), "time_gap"),
        (FoundScene("cut_in", {"time_gap": 0.1}), "between 0.8 and 2.5"),
    ],
)
def test_what_no_family_has_is_named(scene, said):
    with pytest.raises(ConfigError, match=said):
        found_missions([scene])


def test_every_family_has_numbers_with_ranges():
    for family in FAMILIES.values():
        assert set(family.plane) <= set(vars(family.numbers))
