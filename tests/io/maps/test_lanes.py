"""From stated lanes to a graph: what is repaired, what is left out, and what the report says of it."""

from pathlib import Path

import numpy as np
import pytest

from urbanjax.io.figures.maps import draw_map
from urbanjax.io.maps import validity
from urbanjax.io.maps.centre import borders, centre_line
from urbanjax.io.maps.lanes import assemble, may_cross
from urbanjax.io.maps.road import MapLane
from urbanjax.io.maps.xml import MapError
from urbanjax.roadmap.builders import relations
from urbanjax.roadmap.graph import RoadType, Rule, Turn

HERE = Path("map.xml")


def lane(key, *points, width=4.0, **fields):
    left, right = borders(np.array(points, float), width)
    return MapLane(key, left, right, paired=True, **fields)


def made(*lanes):
    return assemble(HERE, "made up", lanes=lanes)


def kinds(found):
    return {(fault.kind, fault.lane) for fault in validity.report(found).faults}


def follows(found):
    graph = found.graph
    links = zip(*np.nonzero(np.asarray(graph.has_successor)), strict=True)
    return {(found.ids[i], found.ids[int(graph.successor[i, k])]) for i, k in links}


def test_lanes_without_length_are_passed_through():
    found = made(
        lane("a", (0, 0), (20, 0), successors=("dot",)),
        lane("dot", (20, 0), (20.01, 0), successors=("loop", "b")),
        lane("loop", (20, 0), (20, 0), successors=("dot",)),
        lane("b", (20, 0), (50, 0)),
    )
    assert found.ids == ("a", "b")
    assert follows(found) == {("a", "b")}
    assert {("zero length", "dot"), ("zero length", "loop")} <= kinds(found)


def test_links_the_wrong_way_round_are_turned_and_wide_gaps_left_out():
    found = made(
        lane("a", (0, 0), (20, 0), predecessors=("b",)),
        lane("b", (20, 0), (50, 0), successors=("a", "far"), predecessors=()),
        lane("far", (90, 0), (120, 0), predecessors=("b",)),
    )
    assert follows(found) == {("a", "b")}
    assert {("turned link", "b"), ("gap", "b")} <= kinds(found)


def test_a_link_that_one_lane_states_counts_and_is_reported():
    found = made(
        lane("a", (0, 0), (20, 0), predecessors=()),
        lane("b", (20, 0), (50, 0), predecessors=("a", "none")),
    )
    assert follows(found) == {("a", "b")}
    assert {("one-sided link", "b"), ("dangling link", "b")} == kinds(found)


def test_turns_are_told_from_the_heading_at_forks_only():
    bend = [(20 + 10 * np.sin(a), 10 - 10 * np.cos(a)) for a in np.linspace(0, np.pi / 2, 9)]
    right = [(x, -y) for x, y in bend]
    back = [(20 + 4 * np.sin(a), 4 - 4 * np.cos(a)) for a in np.linspace(0, np.pi, 17)]
    found = made(
        lane("in", (0, 0), (20, 0), successors=("l", "r", "s", "u")),
        lane("l", *bend, successors=("on",)),
        lane("r", *right),
        lane("s", (20, 0), (40, 0)),
        lane("u", *back),
        lane("on", (30, 10), (30, 14), (34, 18), (50, 18)),
    )
    turns = {key: Turn(int(found.graph.turn[found.link(key)])) for key in found.ids}
    assert turns == {
        **{"in": Turn.STRAIGHT, "l": Turn.LEFT, "r": Turn.RIGHT, "s": Turn.STRAIGHT},
        **{"u": Turn.U_TURN, "on": Turn.STRAIGHT},
    }


def test_a_rule_at_the_starts_of_most_ways_holds_at_the_end_of_the_lane_before():
    found = made(
        lane("most", (0, 0), (20, 0), successors=("a", "b")),
        lane("few", (0, 10), (20, 10), successors=("c", "d", "e")),
        lane("a", (20, 0), (40, 0), entry_rule=Rule.STOP),
        lane("b", (20, 0), (40, 2)),
        lane("c", (20, 10), (40, 10), entry_rule=Rule.YIELD, rule=Rule.STOP),
        lane("d", (20, 10), (40, 12)),
        lane("e", (20, 10), (40, 8)),
    )
    rules = {key: Rule(int(found.graph.rule[found.link(key)])) for key in found.ids}
    assert {key for key in rules if rules[key] != Rule.NONE} == {"most", "c"}
    assert (rules["most"], rules["c"]) == (Rule.STOP, Rule.STOP)


def test_lanes_that_cross_are_a_junction_unless_the_map_says_otherwise():
    found = made(
        lane("east", (-30, 0), (30, 0)),
        lane("north", (0, -30), (0, 30)),
        lane("bridge", (10, -30), (10, 30), road_type=RoadType.URBAN),
        lane("beside", (-30, 4), (30, 4.0)),
        lane("aslant", (-30, 12), (30, 20)),
    )
    types = {key: RoadType(int(found.graph.road_type[found.link(key)])) for key in found.ids}
    assert types["bridge"] == RoadType.URBAN
    assert {types[key] for key in ("east", "north", "beside", "aslant")} == {RoadType.JUNCTION}
    alone = made(lane("a", (0, 0), (30, 0)), lane("b", (0, 4), (30, 4)))
    assert set(np.asarray(alone.graph.road_type).tolist()) == {int(RoadType.URBAN)}


def test_border_points_in_the_wrong_order_make_no_loop():
    left = np.array([[0, 4], [10, 4], [5, 4], [20, 4.0]])
    line = centre_line(MapLane("a", left, np.array([[0, 0], [20, 0.0]])))
    assert line.length == pytest.approx(20.0)
    np.testing.assert_allclose(line.heading, 0.0, atol=1e-9)


def test_the_report_names_overlaps_swapped_borders_twins_and_dead_ends():
    square = [lane(k, *line) for k, line in enumerate([[(-90, y), (90, y)] for y in (-90, 90)])]
    knot = np.array([[30, 0], [40, 0], [40, 5], [35, -5.0]])
    found = made(
        *square,
        lane("dead", (-90, 0), (0, 0)),
        lane("twin", (-90, 0), (0, 0)),
        MapLane("knot", knot + np.array([0, 3]), knot),
        MapLane("swapped", np.array([[-90, 40], [90, 40.0]]), np.array([[-90, 44], [90, 44.0]])),
    )
    found_kinds = kinds(found)
    assert {("dead end", "dead"), ("dead end", "twin"), ("twice", "twin"), ("self-overlap", "knot")} <= found_kinds
    assert ("swapped borders", "swapped") in found_kinds
    assert not {(kind, key) for kind, key in found_kinds if key in (0, 1)}
    text = validity.report(found).text()
    assert "dead end: " in text
    assert "lane dead: no successor" in text
    assert "nothing looks wrong" in validity.report(made(*square)).text()


def test_the_origin_is_the_middle_and_positions_stay_exact_far_out():
    found = made(lane("a", (4.5e6, 3.1e6), (4.5e6 + 100.25, 3.1e6)))
    assert found.graph.origin == (4500050.0, 3100000.0)
    end = np.asarray(found.graph.centre[0, -1], float) + found.graph.origin
    np.testing.assert_allclose(end, [4500100.25, 3.1e6], atol=1e-4)
    assert found.graph.centre.shape[1] == 64


@pytest.mark.parametrize(
    ("marking", "side", "allowed"),
    [
        ("dashed", "left", True),
        ("broad_dashed", "right", True),
        ("solid", "left", False),
        ("no_marking", "left", True),
        ("curb", "left", False),
        ("unknown", "left", None),
        (None, "left", None),
        ("dashed_solid", "right", True),
        ("dashed_solid", "left", False),
    ],
)
def test_the_own_half_of_a_line_decides(marking, side, allowed):
    assert may_cross(marking, side) is allowed


def test_what_makes_no_graph_is_refused():
    with pytest.raises(MapError, match=r"map.xml: holds no lane"):
        made()
    with pytest.raises(MapError, match="none of its 1 lanes has a length"):
        made(lane("a", (0, 0), (0, 0)))
    with pytest.raises(MapError, match="'a' occurs twice"):
        made(lane("a", (0, 0), (9, 0)), lane("a", (0, 0), (9, 0)))
    with pytest.raises(MapError, match="'b' reaches 20 km away"):
        made(lane("a", (0, 0), (9, 0)), lane("c", (0, 9), (9, 9)), lane("b", (1e6, 0), (1e6 + 9, 0)))
    with pytest.raises(MapError, match="'b' is no link"):
        made(lane("a", (0, 0), (9, 0))).link("b")


def test_too_many_lanes_on_top_of_each_other_are_refused(monkeypatch):
    monkeypatch.setattr(relations, "MOST_PAIRS", 1000)
    with pytest.raises(MapError, match=r"map.xml: too many lanes lie on top of each other"):
        made(*(lane(k, (0, 0), (40, 0)) for k in range(40)))
    monkeypatch.setattr(relations, "MOST_PIECES", 10)
    with pytest.raises(MapError, match=r"map.xml: the lanes are 2 km long"):
        made(*(lane(k, (0, 9 * k), (40, 9 * k)) for k in range(40)))


def test_a_map_is_drawn(tmp_path):
    path = tmp_path / "map.png"
    draw_map(made(lane("a", (0, 0), (30, 0), successors=("b",)), lane("b", (30, 0), (60, 10))), path)
    assert path.stat().st_size > 5000
