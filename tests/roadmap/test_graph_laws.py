"""Laws of every road graph: relations are mutual, places agree, stations are uniform."""

import numpy as np
import pytest

from tests.roadmap.oracle import pairs

KINDS = ("straight", "two_way", "coinciding", "curve", "merge", "crossing", "roundabout", "district")


@pytest.fixture(params=KINDS)
def graph(request, graphs):
    return graphs[request.param]


def side_pairs(graph, side):
    return pairs(getattr(graph, f"{side}_link")[:, None], getattr(graph, f"has_{side}")[:, None])


def at(graph, link, station):
    """Position on the polyline of a link, by numpy."""
    line, grid = np.asarray(graph.centre[link], float), np.asarray(graph.station[link], float)
    return np.array([np.interp(station, grid, line[:, 0]), np.interp(station, grid, line[:, 1])])


def test_predecessors_are_the_dual_of_successors(graph):
    succession = pairs(graph.successor, graph.has_successor)
    assert {(j, i) for i, j in succession} == pairs(graph.predecessor, graph.has_predecessor)


def test_successors_start_where_and_as_the_link_ends(graph):
    for i, j in pairs(graph.successor, graph.has_successor):
        np.testing.assert_allclose(graph.centre[i, -1], graph.centre[j, 0], atol=1e-3)
        turned = graph.heading[i, -1] - graph.heading[j, 0]
        assert abs(np.sin(turned / 2)) < 2e-3


def test_neighbours_are_mutual_and_lie_on_their_side(graph):
    left, right = side_pairs(graph, "left"), side_pairs(graph, "right")
    assert {(j, i) for i, j in left} == right
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for i, j in side_pairs(graph, side):
            for p in (0, graph.centre.shape[1] // 2, -1):
                there = at(graph, j, float(getattr(graph, f"{side}_station")[i, p]))
                away = there - np.asarray(graph.centre[i, p])
                h = float(graph.heading[i, p])
                offset = np.array([-np.sin(h), np.cos(h)]) @ away
                assert 2.0 < sign * offset < 5.0
                assert abs(np.array([np.cos(h), np.sin(h)]) @ away) < 0.1


def test_station_maps_of_neighbours_are_inverse(graph):
    for i, j in side_pairs(graph, "left"):
        forth = np.asarray(graph.left_station[i])
        back = np.interp(forth, np.asarray(graph.station[j]), np.asarray(graph.right_station[j]))
        np.testing.assert_allclose(back, graph.station[i], atol=0.05)


def test_borders_contain_the_centre(graph):
    n = np.stack([-np.sin(graph.heading), np.cos(graph.heading)], -1)
    left = np.sum(n * np.asarray(graph.left - graph.centre), -1)
    right = np.sum(n * np.asarray(graph.right - graph.centre), -1)
    assert np.all(left > 0.5)
    assert np.all(right < -0.5)


def test_stations_are_uniform_and_agree_with_the_chords(graph):
    p = graph.centre.shape[1]
    np.testing.assert_allclose(graph.station, np.asarray(graph.length)[:, None] * np.linspace(0, 1, p), rtol=1e-5)
    chords = np.linalg.norm(np.diff(np.asarray(graph.centre, float), axis=1), axis=-1).sum(-1)
    np.testing.assert_allclose(chords, graph.length, rtol=2e-3)


def test_opposites_and_conflicts_are_symmetric_and_exclude_each_other(graph):
    opposite, conflict = pairs(graph.opposite, graph.has_opposite), pairs(graph.conflict, graph.has_conflict)
    assert {(j, i) for i, j in opposite} == opposite
    assert {(j, i) for i, j in conflict} == conflict
    assert not opposite & conflict
    assert not conflict & pairs(graph.successor, graph.has_successor)


def test_opposites_lie_side_by_side_or_coincide(graph):
    centre = np.asarray(graph.centre, float)
    for i, k in zip(*np.nonzero(np.asarray(graph.has_opposite)), strict=True):
        aside = abs(float(graph.opposite_offset[i, k]))
        between = np.linalg.norm(centre[i][:, None] - centre[int(graph.opposite[i, k])][None], axis=-1).min()
        assert aside < 0.5 or between > 0.7 * aside, (i, aside, between)
