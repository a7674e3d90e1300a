"""Lanelet2: topology from shared points and ways, rules, signals, both coordinate systems."""

import re

import numpy as np
import pytest

from tests.io.maps import texts
from urbanjax.io import maps
from urbanjax.io.maps.geodesy import transverse_mercator
from urbanjax.roadmap.graph import RoadType, Rule, Turn


@pytest.fixture
def found(read):
    return read(texts.lanelet2(), "map.osm")


def test_lanelets_follow_and_lie_beside_each_other(found):
    graph = found.graph
    assert set(found.ids) == {41, 42, 43, 44, -44}
    assert found.other["crosswalk lanelets"] == 1
    one, two, three = (found.link(lane) for lane in (41, 42, 43))
    assert np.asarray(graph.has_successor).sum() == 1
    assert int(graph.successor[one, 0]) == three
    assert int(graph.left_link[one]) == two
    assert int(graph.right_link[two]) == one
    # The line between them is solid on the left of its own direction, which is against theirs: dashed on the left.
    assert bool(graph.left_change[one]) is False
    assert bool(graph.right_change[two]) is True
    both = {found.link(44), found.link(-44)}
    assert {int(graph.opposite[i, 0]) for i in both} == both


def test_a_lanelet_runs_so_that_its_left_border_is_on_the_left(found):
    graph = found.graph
    ends = {lane: np.asarray(graph.centre[found.link(lane)], float)[[0, -1]] + graph.origin for lane in found.ids}
    np.testing.assert_allclose(ends[41], [[80000, 1.75], [80040, 1.75]], atol=1e-3)
    np.testing.assert_allclose(ends[44], [[80000, -23], [80040, -23]], atol=1e-3)
    np.testing.assert_allclose(ends[-44], ends[44][::-1], atol=1e-3)
    np.testing.assert_allclose(graph.length[found.link(43)], 30.0, rtol=1e-5)


def test_rules_limits_turns_and_signals(found):
    graph = found.graph
    one, two, three = (found.link(lane) for lane in (41, 42, 43))
    assert float(graph.speed_limit[one]) == pytest.approx(10.0)
    assert float(graph.speed_limit[two]) == pytest.approx(20 * 0.44704)
    assert float(graph.speed_limit[three]) == pytest.approx(50 / 3.6)
    assert int(graph.turn[three]) == Turn.STRAIGHT
    assert int(graph.road_type[three]) == RoadType.JUNCTION
    assert {found.ids[i] for i in np.flatnonzero(np.asarray(graph.rule) == Rule.STOP)} == {44, -44}
    assert found.signal_ids == (29,)
    assert np.flatnonzero(np.asarray(graph.has_signal).any(1)).tolist() == [one]
    assert float(graph.stop_line[one, 0]) == pytest.approx(39.0, abs=1e-3)


def test_positions_in_degrees_give_the_same_map(found, read):
    there = read(texts.lanelet2(local=False), "degrees.osm")
    assert found.geo is None
    assert there.geo == pytest.approx((48 - 9.5 / 111198, 11 + 35 / 74633), abs=1e-6)
    np.testing.assert_allclose(there.graph.length, found.graph.length, rtol=1e-3)
    between = [np.asarray(m.graph.centre, float) - np.asarray(m.graph.centre[0, 0], float) for m in (found, there)]
    np.testing.assert_allclose(between[1], between[0], atol=0.05)
    np.testing.assert_array_equal(there.graph.successor, found.graph.successor)


def test_the_projection_has_the_lengths_of_the_ellipsoid():
    # The meridian from the equator to 45 degrees, and UTM's easting of the edge of a zone at the equator.
    north = transverse_mercator(np.array([45.0]), np.array([9.0]), middle=(0.0, 9.0))
    np.testing.assert_allclose(north, [[0.0], [4_984_944.378]], atol=1e-3)
    east, _ = transverse_mercator(np.array([0.0]), np.array([12.0]), middle=(0.0, 9.0))
    np.testing.assert_allclose(0.9996 * east + 500_000, 833_978.557, atol=2e-2)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('<nd ref="4"/>', '<nd ref="99"/>', "the node 99 is missing, which it names"),
        ('role="left" ref="22"', 'role="left" ref="99"', '<relation id="41">: the way 99 is missing'),
        ('role="left" ref="22"', 'role="right" ref="22"', '<relation id="41">: has 0 left borders'),
        ('<tag k="local_x" v="80040"/>', "", '<node id="2">: has no local_x and local_y'),
        ('v="80040"', 'v="x"', '<node id="2">: local_x, local_y holds a coordinate'),
        ('v="36"', 'v="fast"', '<relation id="41">: speed_limit is'),
        ('<way id="21">\n<nd ref="1"/>', '<way id="21">', '<way id="21">: has 1 points'),
        ('subtype" v="road"', 'subtype" v="steps"', None),
    ],
)
def test_an_error_names_the_element(read, old, new, message):
    text = texts.lanelet2().replace(old, new, -1 if message is None else 1)
    assert text != texts.lanelet2()
    with pytest.raises(maps.MapError) as error:
        read(text, "map.osm")
    assert "map.osm: " in str(error.value)
    assert (message or "holds no lane") in str(error.value)


def test_new_elements_of_an_editor_have_negative_ids(found, read):
    there = read(re.sub(r'(<relation id="|"relation"[^>]* ref=")', r"\1-", texts.lanelet2()), "map.osm")
    assert set(there.ids) == {-key for key in found.ids}
    np.testing.assert_array_equal(there.graph.has_successor.sum(), found.graph.has_successor.sum())


def test_a_node_far_away_is_named(read):
    with pytest.raises(maps.MapError, match=r'<node id="[0-9]+">: lies more than a degree'):
        read(texts.lanelet2(local=False).replace('lat="48.000000000"', 'lat="58"', 1), "map.osm")
