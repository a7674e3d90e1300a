"""Known answers of the builders of road graphs, and what they refuse."""

import numpy as np
import pytest

from tests.roadmap.oracle import pairs
from urbanjax.roadmap import builders
from urbanjax.roadmap.builders import LaneSpec, assemble, roundabout
from urbanjax.roadmap.builders.curves import connect, trace, turn
from urbanjax.roadmap.builders.specs import RoadStyle
from urbanjax.roadmap.graph import RoadType, Rule
from urbanjax.roadmap.padding import GraphSize, pad
from urbanjax.roadmap.route import route_between
from urbanjax.types import RoadError


def test_two_way_opposite_lane_is_one_lane_to_the_left(graphs):
    graph = graphs["two_way"]
    assert pairs(graph.opposite, graph.has_opposite) == {(0, 1), (1, 0)}
    np.testing.assert_allclose(graph.opposite_offset[:, 0], 3.5, atol=1e-5)
    assert np.all(graph.left_change)
    assert not np.any(graph.has_left)


def test_coinciding_lane_is_known_as_opposite_without_offset(graphs):
    graph = graphs["coinciding"]
    offset = {
        (i, int(graph.opposite[i, k])): float(graph.opposite_offset[i, k])
        for i, k in zip(*np.nonzero(np.asarray(graph.has_opposite)), strict=True)
    }
    assert offset == pytest.approx({(0, 2): 0.0, (2, 0): 0.0, (1, 2): 3.5, (2, 1): 3.5}, abs=1e-4)


def test_curve_has_the_curvature_of_its_radius():
    graph = builders.curve(radius=40.0, angle=-1.2, n_lanes=1, transition=0.0)
    middle = np.asarray(graph.area) == graph.area_names.index("curve")
    np.testing.assert_allclose(graph.curvature[middle][:, 3:-3], -1 / (40.0 - 1.75), rtol=1e-3)
    np.testing.assert_allclose(graph.heading[-1, -1], -1.2, atol=1e-5)


def test_an_arc_given_as_points_only_gets_its_curvature():
    angle = np.linspace(0, 1.0, 300)
    graph = assemble([LaneSpec("arc", 30 * np.stack([np.sin(angle), 1 - np.cos(angle)], -1))])
    np.testing.assert_allclose(graph.curvature[0], 1 / 30, rtol=5e-3)
    np.testing.assert_allclose([graph.heading[0, 0], graph.heading[0, -1]], [0.0, 1.0], atol=1e-3)
    np.testing.assert_allclose(graph.length[0], 30.0, rtol=1e-4)


def test_merging_lane_ends_beside_a_lane_that_goes_on(graphs):
    graph = graphs["merge"]
    ramp = int(np.flatnonzero(np.asarray(graph.area) == graph.area_names.index("ramp"))[0])
    lane = int(graph.successor[ramp, 0])
    assert not np.any(graph.has_successor[lane])
    assert graph.left_change[lane]
    assert graph.has_successor[graph.left_link[lane], 0]


def test_crossing_conflicts_where_paths_cross_or_merge(crossing):
    def links(name):
        return set(np.flatnonzero(np.asarray(crossing.area) == crossing.area_names.index(name)).tolist())

    conflict = pairs(crossing.conflict, crossing.has_conflict)

    def all_meet(a, b):
        return all((i, j) in conflict for i in links(a) for j in links(b))

    assert all_meet("west straight", "south straight")
    assert all_meet("west left", "east straight")
    assert not any((i, j) in conflict for i in links("west straight") for j in links("east straight"))
    assert not any((i, j) in conflict for i in links("west left") for j in links("west straight"))
    assert all(
        (i, j) in conflict for i in links("west right") for j in links("north straight") if shares(crossing, i, j)
    )
    assert crossing.n_signals == 4


def shares(graph, i, j):
    return int(graph.successor[i, 0]) == int(graph.successor[j, 0])


def test_a_roundabout_is_a_ring_that_has_priority():
    graph, radius = roundabout(18.0), 18.0
    names = np.array(graph.area_names)[np.asarray(graph.area)]
    ring = np.flatnonzero(names == "ring")
    np.testing.assert_allclose(np.linalg.norm(np.asarray(graph.centre)[ring], axis=-1), radius, atol=1e-3)
    np.testing.assert_allclose(np.asarray(graph.curvature)[ring], 1 / radius, rtol=1e-2)
    assert float(np.sum(np.asarray(graph.length)[ring])) == pytest.approx(2 * np.pi * radius, rel=1e-3)
    assert (np.asarray(graph.road_type)[ring] == RoadType.JUNCTION).all()
    for k in range(4):
        assert graph.rule[k] == Rule.YIELD
        for onwards in range(4):  # from every leg to every leg, back to its own too, once round the ring
            route = route_between(graph, k, goal=4 + (k + onwards) % 4)
            links = np.asarray(route.link)[np.asarray(route.valid)]
            assert np.isin(links, ring).sum() == 2 * ((onwards - 1) % 4) + 1
    with pytest.raises(RoadError, match="radius"):
        roundabout(5.0)


def test_district_closes_and_has_the_named_areas(district, course_links):
    assert int(district.successor[course_links[-1], 0]) == 0
    assert int(district.predecessor[0, 0]) == course_links[-1]
    np.testing.assert_allclose(district.centre[course_links[-1], -1], district.centre[0, 0], atol=1e-3)
    np.testing.assert_allclose(district.heading[course_links[-1], -1] - 2 * np.pi, district.heading[0, 0], atol=1e-5)
    assert 4500 < float(np.sum(np.asarray(district.length)[course_links])) < 5500
    names = [district.area_names[int(district.area[i])] for i in course_links]
    order = [name for name in dict.fromkeys(names) if name]
    assert order == [
        *(
            "curve A",
            "curve B",
            "intersection C",
            "curve D",
            "curve E",
            "straight H",
            "curve F",
            "straight I",
            "curve G",
        )
    ]


def test_district_has_two_to_four_lanes_and_signals_on_all_of_them(district, course_links):
    has_right, right = np.asarray(district.has_right), np.asarray(district.right_link)

    def count(link):
        return 1 + count(right[link]) if has_right[link] else 1

    assert {count(i) for i in course_links} == {2, 3, 4}
    governed = [i for i in course_links if district.has_signal[i, 0]]
    assert len(governed) == 8
    for i in governed:
        while has_right[i]:
            assert int(district.signal[right[i], 0]) == int(district.signal[i, 0])
            i = right[i]
    assert len(district.length) < 300


def test_padding_is_invalid_and_finite():
    graph = builders.straight(n_lanes=1, length=50.0, style=RoadStyle(n_points=4))
    spec = LaneSpec("a", np.array([[0.0, 0.0], [50.0, 0.0]]))
    padded = assemble(
        [spec], n_points=4, n_signals=5, size=GraphSize(n_links=3, n_successors=2, n_relations=2, n_signals_per_link=2)
    )
    assert np.asarray(padded.valid).tolist() == [True, False, False]
    assert padded.successor.shape == padded.signal.shape == padded.conflict.shape == (3, 2)
    assert padded.n_signals == 5
    np.testing.assert_allclose(padded.centre[2], graph.centre[0])
    assert not np.any(padded.has_successor)


def test_padded_graph_keeps_its_links(crossing):
    more = pad(crossing, size=GraphSize(n_links=40, n_relations=9))
    n = len(crossing.length)
    assert more.conflict.shape == (40, 9)
    np.testing.assert_array_equal(more.centre[:n], crossing.centre)
    assert pairs(more.conflict, more.has_conflict) == pairs(crossing.conflict, crossing.has_conflict)
    with pytest.raises(RoadError, match="n_links is 3"):
        pad(crossing, size=GraphSize(n_links=3))


def test_far_coordinates_get_an_origin():
    centre = np.array([[4.5e6 + 0.25, 3.1e6], [4.5e6 + 60.25, 3.1e6]])
    graph = assemble([LaneSpec("a", centre)], n_points=4)
    np.testing.assert_allclose(np.asarray(graph.centre[0, -1], float) + graph.origin, centre[-1], atol=1e-3)


def test_connect_meets_both_poses():
    for end in ((20.0, 12.0, np.pi / 2), (30.0, 3.0, 0.0), (12.0, -25.0, -2.0)):
        way = connect((1.0, 2.0, 0.0), end)
        np.testing.assert_allclose([*way.position[0], way.heading[0]], [1.0, 2.0, 0.0], atol=1e-6)
        np.testing.assert_allclose([*way.position[-1], way.heading[-1]], end, atol=1e-6)


def test_clothoid_turn_ends_at_its_angle():
    line = trace(turn(np.pi / 2, 50.0, transition=20.0))
    assert line.heading[-1] == pytest.approx(np.pi / 2)
    chords = np.linalg.norm(np.diff(line.position, axis=0), axis=-1).sum()
    assert chords == pytest.approx(line.length, rel=1e-5)


LINE = np.array([[0.0, 0.0], [10.0, 0.0]])


@pytest.mark.parametrize(
    ("specs", "message"),
    [
        ([], "empty"),
        ([LaneSpec("a", LINE), LaneSpec("a", LINE)], "'a' is used twice"),
        ([LaneSpec("a", LINE * np.nan)], "'a': .* not finite"),
        ([LaneSpec("a", LINE[:1])], "'a': centre has shape"),
        ([LaneSpec("a", LINE * 0)], "'a' has no length"),
        ([LaneSpec("a", LINE, width=-1.0)], "'a': width must be positive"),
        ([LaneSpec("a", LINE, speed_limit=0.0)], "'a': speed limit"),
        ([LaneSpec("a", LINE, successors=("b",))], "'a' names the unknown lane 'b'"),
        ([LaneSpec("a", LINE, left="c")], "'a' names the unknown lane 'c'"),
        ([LaneSpec("a", LINE, left="a")], "'a' is its own neighbour"),
        ([LaneSpec("a", LINE, successors=("b",)), LaneSpec("b", LINE + 50)], "ends .* from the start of its successor"),
        ([LaneSpec("a", LINE, signals=((0, 99.0),))], "'a': a signal id"),
        ([LaneSpec("a", LINE, heading=np.zeros(5))], "'a': width or heading"),
    ],
)
def test_bad_networks_are_refused_by_name(specs, message):
    with pytest.raises(RoadError, match=message):
        assemble(specs)


@pytest.mark.parametrize(
    "build",
    [
        lambda: builders.straight(n_lanes=0),
        lambda: builders.straight(length=-5.0),
        lambda: builders.straight(style=RoadStyle(lane_width=float("nan"))),
        lambda: builders.two_way(n_opposite=0),
        lambda: builders.curve(radius=-1.0),
        lambda: builders.curve(radius=5.0, angle=-1.0, n_lanes=3),
        lambda: builders.curve(angle=0.0),
        lambda: builders.merge(parallel=0.0),
        lambda: builders.intersection(n_lanes=0),
        lambda: builders.intersection(size=1.0),
        lambda: assemble([LaneSpec("a", LINE), LaneSpec("b", LINE + 5)], size=GraphSize(n_links=1)),
    ],
)
def test_bad_sizes_are_refused(build):
    with pytest.raises(RoadError):
        build()
