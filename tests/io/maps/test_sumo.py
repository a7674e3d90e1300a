"""SUMO networks: lanes for cars, connections through junctions, signals and priority."""

import numpy as np
import pytest

from tests.io.maps import texts
from urbanjax.io import maps
from urbanjax.roadmap.graph import RoadType, Rule, Turn
from urbanjax.types import SignalState

pytestmark = pytest.mark.filterwarnings("ignore::urbanjax.io.maps.DanglingWarning")


@pytest.fixture
def found(read):
    return read(texts.SUMO, "net.xml")


def follows(found):
    graph = found.graph
    links = zip(*np.nonzero(np.asarray(graph.has_successor)), strict=True)
    return {(found.ids[i], found.ids[int(graph.successor[i, k])]) for i, k in links}


def test_lanes_lead_through_the_junction(found):
    assert found.other["lanes"] == 9
    assert found.other["lanes without cars"] == 1
    assert follows(found) == {
        ("in_0", ":j_0_0"),
        ("in_1", ":j_1_0"),
        (":j_0_0", "on_0"),
        (":j_1_0", "up_0"),  # through a lane without length
    }
    kinds = [(fault.kind, fault.lane) for fault in found.faults]
    assert ("zero length", ":j_2_0") in kinds
    assert ("dangling link", "up_0") in kinds
    assert ("gap", "in_1") in kinds  # a connection to a lane elsewhere


def test_geometry_and_neighbours(found):
    graph = found.graph
    zero, one = found.link("in_0"), found.link("in_1")
    assert float(graph.length[zero]) == pytest.approx(40.0)
    widths = np.linalg.norm(np.asarray(graph.left - graph.right), axis=-1)
    np.testing.assert_allclose(widths[[zero, one]].mean(1), [3.2, 3.0], rtol=1e-5)
    assert int(graph.left_link[zero]) == one
    assert bool(graph.left_change[zero])
    assert not bool(graph.right_change[one])  # for buses only
    assert not bool(graph.has_left[one])  # a cycle lane
    assert float(graph.speed_limit[found.link("up_0")]) == pytest.approx(8.3)


def test_turns_and_rules(found):
    graph = found.graph
    turns = {lane: Turn(int(graph.turn[found.link(lane)])) for lane in (":j_0_0", ":j_1_0", "in_1")}
    assert turns == {":j_0_0": Turn.STRAIGHT, ":j_1_0": Turn.LEFT, "in_1": Turn.STRAIGHT}
    junction = {found.ids[i] for i in np.flatnonzero(np.asarray(graph.road_type) == RoadType.JUNCTION)}
    assert junction == {":j_0_0", ":j_1_0", ":k_0_0"}
    # Inside the junction one waits at the end of the first part of the left turn.
    assert {found.ids[i] for i in np.flatnonzero(np.asarray(graph.rule) == Rule.YIELD)} == {":j_1_0"}


def test_a_signal_governs_the_lane_or_else_the_ways_on_from_it(found):
    graph = found.graph
    assert set(found.signal_ids) == {("j", 0), ("j", 1)}
    governed = {
        found.ids[i]: (found.signal_ids[int(graph.signal[i, k])], float(graph.stop_line[i, k]))
        for i, k in zip(*np.nonzero(np.asarray(graph.has_signal)), strict=True)
    }
    # From in_1 there are two ways with signals of their own, one of which passes through no lane of a junction.
    assert governed == {"in_0": (("j", 0), pytest.approx(40.0)), ":j_1_0": (("j", 1), pytest.approx(0.0))}
    cycle = found.cycles[found.signal_ids.index(("j", 1))]
    assert cycle.duration == (30.0, 4.0, 26.0)
    assert cycle.state == (SignalState.RED, SignalState.RED, SignalState.GREEN)
    assert cycle.offset == 5.0


def test_links_that_show_the_same_share_a_signal(read):
    text = texts.SUMO.replace('"Gr"', '"GG"').replace('"yr"', '"yy"').replace('"rG"', '"rr"')
    found = read(text, "net.xml")
    assert found.signal_ids == (("j", 0),)
    governed = np.flatnonzero(np.asarray(found.graph.has_signal).any(1))
    assert {found.ids[i] for i in governed} == {"in_0", "in_1"}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"40.0,-1.6 60.0,-1.6"', '"40.0,-1.6"', '<lane id=":j_0_0">: its shape has not two points'),
        ('"40.0,-1.6 60.0,-1.6"', '"40.0,-1.6 60.0"', '<lane id=":j_0_0">: its shape has not two points'),
        ('"40.0,-1.6 60.0,-1.6"', '"40.0,-1.6 60.0,nan"', '<lane id=":j_0_0">: its shape holds a coordinate'),
        ('speed="10"', "", "<lane id=\":j_0_0\">: the attribute 'speed' is missing"),
        ('speed="10"', 'speed="-3"', '<lane id=":j_0_0">: speed is'),
        ('index="1" speed="13.9"', 'index="x" speed="13.9"', '<lane id="in_1">: index is'),
        ('width="3.0"', 'width="1e9"', '<lane id="in_1">: width is'),
        ('state="yr"', 'state="y"', '<tlLogic id="j">: a phase has no state for the link index 1'),
        ('<tlLogic id="j"', '<tlLogic id="i"', "names the traffic light 'j', which has no <tlLogic>"),
        ('duration="30"', 'duration="inf"', '<tlLogic id="j">: duration is'),
        ('<edge id="on"', '<edge id="up"', '<edge id="up">: the id occurs twice'),
        ('fromLane="1"', "", "<connection from=\"in\">: the attribute 'fromLane' is missing"),
    ],
)
def test_an_error_names_the_element(read, old, new, message):
    text = texts.SUMO.replace(old, new, 1)
    assert text != texts.SUMO
    with pytest.raises(maps.MapError) as error:
        read(text, "net.xml")
    assert "net.xml: " in str(error.value)
    assert message in str(error.value)
