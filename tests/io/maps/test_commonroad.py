"""CommonRoad: lanelets, rules, signals, recorded traffic and planning problems of small files."""

import numpy as np
import pytest

from tests.io.maps import texts
from urbanjax.io import maps
from urbanjax.roadmap.graph import RoadType, Rule, Turn
from urbanjax.types import SignalState


@pytest.fixture
def found(read):
    return read(texts.COMMONROAD)


def pairs(found, table, mask):
    links = zip(*np.nonzero(np.asarray(mask)), strict=True)
    return {(found.ids[i], found.ids[int(table[i, k])]) for i, k in links}


def test_links_follow_and_lie_beside_each_other(found):
    graph = found.graph
    assert found.format == "CommonRoad 2020a"
    assert set(found.ids) == {1, 2, 3, 4, 5}
    assert found.other["undrivable lanelets"] == 1
    assert pairs(found, graph.successor, graph.has_successor) == {(1, 3), (2, 4)}
    one, two, five = (found.link(lane) for lane in (1, 2, 5))
    assert bool(graph.has_left[one])
    assert int(graph.left_link[one]) == two
    assert int(graph.right_link[two]) == one
    # Each lane's own side of the line counts; across the dashed line lies the oncoming lane.
    assert not bool(graph.left_change[one])
    assert bool(graph.right_change[two])
    assert not bool(graph.has_left[two])
    assert bool(graph.left_change[two])
    assert pairs(found, graph.opposite, graph.has_opposite) == {(2, 5), (5, 2)}
    np.testing.assert_allclose(graph.left_station[one], graph.station[two], atol=1e-4)
    assert not bool(np.any(graph.has_left[five]))


def test_geometry_is_the_middle_of_the_borders(found):
    graph = found.graph
    np.testing.assert_allclose(graph.length[found.link(1)], 40.0, rtol=1e-6)
    np.testing.assert_allclose(graph.length[found.link(4)], 20 * np.pi / 2, rtol=2e-3)
    centre = np.asarray(graph.centre[found.link(4)], float) + graph.origin
    np.testing.assert_allclose(np.hypot(*(centre - [40.0, 25.25]).T), 20.0, atol=0.05)
    width = np.linalg.norm(np.asarray(graph.left - graph.right), axis=-1)
    np.testing.assert_allclose(width, 3.5, rtol=3e-3)
    np.testing.assert_allclose(np.mean(graph.curvature[found.link(4)]), 1 / 20.0, rtol=0.03)
    assert graph.origin == (30.0, 14.0)


def test_rules_limits_and_turns(found):
    graph = found.graph
    limits = {lane: float(graph.speed_limit[found.link(lane)]) for lane in (1, 2, 3)}
    assert limits == pytest.approx({1: 10.0, 2: 25 * 0.44704, 3: 50 / 3.6}, rel=1e-6)
    rules = {lane: Rule(int(graph.rule[found.link(lane)])) for lane in found.ids}
    assert rules == {1: Rule.NONE, 2: Rule.NONE, 3: Rule.NONE, 4: Rule.NONE, 5: Rule.STOP}
    assert int(graph.turn[found.link(4)]) == Turn.LEFT
    assert int(graph.road_type[found.link(4)]) == RoadType.JUNCTION
    assert int(graph.road_type[found.link(1)]) == RoadType.URBAN


def test_a_signal_stands_at_its_stop_line_and_has_its_cycle(found):
    graph, one = found.graph, found.link(1)
    assert found.signal_ids == (20,)
    assert graph.n_signals == 1
    assert np.flatnonzero(np.asarray(graph.has_signal).any(1)).tolist() == [one]
    assert float(graph.stop_line[one, 0]) == pytest.approx(38.0, abs=1e-4)
    (cycle,) = found.cycles
    assert cycle.duration == pytest.approx((20.0, 10.0, 3.0))
    assert cycle.state == (SignalState.RED, SignalState.GREEN, SignalState.YELLOW)
    assert cycle.offset == pytest.approx(5.0)


def test_a_recording_is_on_one_clock_around_the_graphs_origin(found):
    recording, origin = found.recording, np.array(found.graph.origin)
    assert recording.ids == (100, 101)
    assert recording.kind == ("car", "parkedVehicle")
    assert recording.standing.tolist() == [False, True]
    assert recording.valid.all()
    assert recording.dt == 0.1
    np.testing.assert_allclose(recording.position[:, 0] + origin, [[5, 1.75], [6, 1.75], [7, 1.75]])
    np.testing.assert_allclose(recording.position[:, 1] + origin, [[30, 5.25]] * 3)
    np.testing.assert_allclose(recording.speed, [[10.0, 0.0]] * 3)
    np.testing.assert_allclose(recording.length, 4.5)
    np.testing.assert_allclose(recording.heading, 0.1)


def test_a_road_user_is_valid_between_its_first_and_last_state(read):
    late = texts.COMMONROAD.replace(
        "<time><exact>0</exact></time>\n<velocity><exact>10.0<", "<time><exact>1</exact></time>\n<velocity><exact>10.0<"
    )
    late = late.replace("<time><exact>2</exact>", "<time><exact>4</exact>").replace(
        "<time><exact>1</exact></time>\n<velocity><exact>10.0</exact></velocity>\n</state>",
        "<time><exact>2</exact></time>\n<velocity><exact>10.0</exact></velocity>\n</state>",
    )
    recording = read(late).recording
    assert recording.valid[:, 0].tolist() == [False, True, True, True, True]
    np.testing.assert_allclose(recording.position[:, 0, 0] - recording.position[0, 0, 0], [0, 0, 1, 1.5, 2])
    assert recording.valid[:, 1].all()


def test_a_planning_problem_keeps_all_its_goals(found):
    (problem,), origin = found.problems, np.array(found.graph.origin)
    np.testing.assert_allclose(np.add(problem.position, origin), [2.0, 1.75])
    assert (problem.speed, problem.heading, problem.time) == (8.0, 0.1, 0.0)
    lane, box = problem.goals
    assert lane.lanes == (4,)
    assert lane.links == (found.link(4),)
    assert lane.time == pytest.approx((1.0, 2.0))
    assert lane.speed == pytest.approx((3.0, 9.0))
    (region,) = box.regions
    np.testing.assert_allclose(np.add(region.centre, origin), [50.0, 1.75])
    assert (region.length, region.width, region.heading) == (6.0, 2.0, 0.5)
    assert box.time == pytest.approx((3.0, 3.0))


def test_the_older_version(read):
    found = read(texts.OLDER)
    assert found.format == "CommonRoad 2018b"
    assert float(found.graph.speed_limit[0]) == 25.5
    assert int(found.graph.road_type[0]) == RoadType.HIGHWAY
    assert found.recording.kind == ("truck", "unknown")
    assert found.recording.standing.tolist() == [False, True]
    assert found.recording.dt == 0.2


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"2020a"', '"2023"', "<commonRoad>: commonRoadVersion is '2023'"),
        ('timeStepSize="0.1"', 'timeStepSize="0"', "<commonRoad>: timeStepSize is '0'"),
        ("<x>20.0000</x>", "<x>east</x>", '<lanelet id="1">: leftBound holds a coordinate'),
        ("<x>20.0000</x>", "<x>1e9</x>", '<lanelet id="1">: leftBound holds a coordinate'),
        ('<lanelet id="3">', '<lanelet id="1">', "the lane 1 occurs twice"),
        ('<lanelet id="3">', '<lanelet id="">', '<lanelet id="">: id is'),
        ("25mph", "25knots", '<trafficSign id="11">: additionalValue is'),
        ("<duration>200<", "<duration>-1<", '<trafficLight id="20">: duration is'),
        ("<color>green<", "<color>grean<", '<trafficLight id="20">: a phase has the colour'),
        ("<time><exact>1</exact>", "<time><exact>0</exact>", '<dynamicObstacle id="100">: the time steps'),
        ("<time><exact>2</exact>", "<time><exact>1e6</exact>", None),
        ("<time><exact>2</exact>", "<time><exact>1e7</exact>", '<dynamicObstacle id="100">: time is'),
        ("<length>4.5<", "<length>nan<", '<dynamicObstacle id="100">: length is'),
        ('<lanelet ref="4"/>', '<lanelet ref="44"/>', '<planningProblem id="200">: its goal is the lanelet 44'),
        ("<intervalEnd>20<", "<intervalEnd>2<", '<planningProblem id="200">: the interval of time ends'),
    ],
)
def test_an_error_names_the_element(read, old, new, message):
    text = texts.COMMONROAD.replace(old, new, 1)
    assert text != texts.COMMONROAD
    if message is None:
        assert read(text).recording.n_times == 1_000_001
        return
    with pytest.raises(maps.MapError) as error:
        read(text)
    assert "map.xml: " in str(error.value)
    assert message in str(error.value)


def test_a_lane_that_is_not_there_is_left_out_with_a_warning(read):
    text = texts.COMMONROAD.replace('<successor ref="3"/>', '<successor ref="99999"/>', 1)
    with pytest.warns(maps.DanglingWarning, match="map.xml: left out .*: lane 1: its successor 99999 is missing"):
        assert 1 in read(text).ids
