"""highway-env's road networks as road graphs: every lane, in its place, connected as it can be driven."""

import jax
import numpy as np
import pytest

from urbanjax.io.bridges.highway.environment import open_environment
from urbanjax.io.bridges.highway.network import read_network
from urbanjax.types import ConfigError, RoadError

ENVIRONMENTS = (
    "highway-v0",
    "merge-v1",
    "two-way-v0",
    "racetrack-v1",
    "roundabout-v0",
    "roundabout-generic-v0",
    "intersection-v0",
    "u-turn-v0",
    "exit-v0",
)


@pytest.fixture(scope="module")
def networks():
    found = {}
    for name in ENVIRONMENTS:
        env = open_environment(name)
        env.reset(seed=0)
        network = env.road.network
        graph, keys = read_network(network)
        found[name] = network, jax.tree.map(np.asarray, graph), keys
    return found


def links(graph, keys):
    """Dicts by key of successors, left and right neighbours that a change may lead to."""
    n = range(len(keys))
    after = {keys[i]: {keys[j] for j in graph.successor[i][graph.has_successor[i]]} for i in n}
    sides = [
        {keys[i]: keys[int(to[i])] for i in n if has[i] and may[i]}
        for to, has, may in (
            (graph.left_link, graph.has_left, graph.left_change),
            (graph.right_link, graph.has_right, graph.right_change),
        )
    ]
    return after, *sides


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_every_lane_lies_where_highway_env_draws_it(networks, name):
    network, graph, keys = networks[name]
    lanes = network.lanes_dict()
    assert {key[:3] for key in keys if key[3] == 0} == set(lanes)
    for i, key in enumerate(keys):
        if key[3] < 0:
            continue  # bridges a hole between lanes
        lane = lanes[key[:3]]
        assert graph.length[i] == pytest.approx(lane.length, abs=3.0, rel=0.02)
        for station in np.linspace(0.0, lane.length, 7):
            point = lane.position(station, 0.0) * [1.0, -1.0]
            gap = np.linalg.norm(graph.centre[i] - point, axis=-1)
            where = int(np.argmin(gap))
            # Between two points of the link the lane is at most half a spacing away, and only along it.
            spacing = float(graph.length[i]) / (graph.centre.shape[1] - 1)
            along = np.array([np.cos(graph.heading[i, where]), np.sin(graph.heading[i, where])])
            away = point - graph.centre[i, where]
            overlap = max(lane.length - float(graph.length[i]), 0.0)
            assert abs(away @ along) < spacing / 2 + overlap + 0.01
            assert abs(away @ [-along[1], along[0]]) < 0.25 + 0.05 * spacing * (spacing < 3.0)
            assert np.cos(graph.heading[i, where] + lane.heading_at(station)) > 0.99
        width = np.linalg.norm(graph.left[i] - graph.right[i], axis=-1)
        assert width == pytest.approx([lane.width_at(station) for station in graph.station[i]], abs=1e-3)


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_left_is_left_and_right_is_right(networks, name):
    _, graph, keys = networks[name]
    for i in range(len(keys)):
        middle = graph.centre.shape[1] // 2
        normal = np.array([-np.sin(graph.heading[i, middle]), np.cos(graph.heading[i, middle])])
        assert ((graph.left[i, middle] - graph.centre[i, middle]) @ normal) > 0
        for has, other, sign in ((graph.has_left, graph.left_link, 1), (graph.has_right, graph.right_link, -1)):
            if has[i]:
                gaps = graph.centre[other[i]] - graph.centre[i, middle]
                nearest = gaps[np.argmin(np.linalg.norm(gaps, axis=-1))]
                assert sign * (nearest @ normal) > 1.0


def test_highway_has_four_lanes_beside_each_other(networks):
    _, graph, keys = networks["highway-v0"]
    after, left, right = links(graph, keys)
    assert all(not following for following in after.values())
    assert left == {("0", "1", i, 0): ("0", "1", i - 1, 0) for i in (1, 2, 3)}
    assert right == {("0", "1", i, 0): ("0", "1", i + 1, 0) for i in (0, 1, 2)}
    assert np.all(graph.speed_limit == 30.0)


def test_merge_leads_from_the_ramp_into_the_road_but_not_back(networks):
    _, graph, keys = networks["merge-v1"]
    after, left, right = links(graph, keys)
    assert after["j", "k", 0, 0] == {("k", "b", 0, 0)}
    assert after["k", "b", 0, 0] == {("b", "c", 2, 0)}
    assert after["b", "c", 2, 0] == set()
    assert after["a", "b", 1, 0] == {("b", "c", 1, 0)}
    assert left["b", "c", 2, 0] == ("b", "c", 1, 0)
    assert ("b", "c", 1, 0) not in right


def test_two_way_knows_that_its_left_lane_is_the_oncoming_one(networks):
    _, graph, keys = networks["two-way-v0"]
    after, left, _ = links(graph, keys)
    assert all(not following for following in after.values())  # the road ends: nobody turns round
    assert left["a", "b", 1, 0] == ("a", "b", 0, 0)
    ours, theirs = keys.index(("a", "b", 0, 0)), keys.index(("b", "a", 0, 0))
    met = graph.opposite[ours][graph.has_opposite[ours]]
    assert met.tolist() == [theirs]
    assert abs(float(graph.opposite_offset[ours, 0])) < 1e-3


def test_racetrack_is_one_closed_course_per_lane(networks):
    _, graph, keys = networks["racetrack-v1"]
    after, *_ = links(graph, keys)
    for lane in (0, 1):
        key, course = ("a", "b", lane, 0), []
        while key not in course:
            course.append(key)
            (key,) = after[key]
        assert len(course) == 9
    _, left, right = links(graph, keys)
    assert ("a", "b", 1, 0) in left
    assert ("f", "g", 1, 0) not in left  # a strip of no road lies between the two lanes
    assert ("f", "g", 0, 0) not in right
    for i in range(len(keys)):
        for j in graph.successor[i][graph.has_successor[i]]:
            step = np.linalg.norm(graph.centre[i, -1] - graph.centre[j, 0])
            assert step < 0.02  # highway-env's arcs overlap by up to 2.6 m


def test_roundabout_holes_are_bridged(networks):
    _, graph, keys = networks["roundabout-v0"]
    after, *_ = links(graph, keys)
    ((bridge),) = after["ses", "se", 0, 0]
    assert bridge[3] < 0
    ((entry),) = after[bridge]
    assert entry[:2] == ("se", "ex")


def test_a_roundabout_is_entered_and_left_round_its_corners(networks):
    _, graph, keys = networks["roundabout-generic-v0"]
    after, *_ = links(graph, keys)
    assert after["ses", "se", 0, 0] == {("se", "ex", 1, 0)}
    assert after["ee", "nx", 1, 0] == {("nx", "ne", 1, 0), ("nx", "nxs", 0, 0)}


def test_intersection_offers_left_straight_and_right(networks):
    _, graph, keys = networks["intersection-v0"]
    after, *_ = links(graph, keys)
    for corner in range(4):
        ways = after[f"o{corner}", f"ir{corner}", 0, 0]
        assert sorted(int(graph.turn[keys.index(way)]) for way in ways) == [0, 1, 2]
    assert graph.has_conflict.any()


def test_long_roads_are_cut_into_pieces_that_stay_beside_each_other(networks):
    network, *_ = networks["highway-v0"]
    graph, keys = read_network(network, max_link=500.0)
    graph = jax.tree.map(np.asarray, graph)
    after, left, _ = links(graph, keys)
    assert len(keys) == 4 * 20
    assert np.allclose(graph.length, 500.0)
    assert after["0", "1", 2, 7] == {("0", "1", 2, 8)}
    assert left["0", "1", 2, 7] == ("0", "1", 1, 7)


def poly_network():
    from highway_env.road.lane import LineType, PolyLane, PolyLaneFixedWidth
    from highway_env.road.road import RoadNetwork

    x = np.linspace(0.0, 60.0, 61)
    lines = (LineType.CONTINUOUS, LineType.CONTINUOUS)

    def points(y):
        return list(zip(x, y + 4 * np.sin(x / 20), strict=True))

    network = RoadNetwork()
    network.add_lane("a", "b", PolyLaneFixedWidth(points(0.0), line_types=lines, speed_limit=None))
    network.add_lane("a", "b", PolyLane(points(4.0), points(2.0), points(6.0), line_types=lines))
    return network


@pytest.mark.parametrize(("respect_lines", "allowed"), [(True, False), (False, True)])
def test_polynomial_lanes_and_lines_between_them(respect_lines, allowed):
    network = poly_network()
    graph, keys = read_network(network, respect_lines=respect_lines)
    assert keys == (("a", "b", 0, 0), ("a", "b", 1, 0))
    assert float(graph.speed_limit[0]) == 30.0
    assert graph.has_right[0]
    assert bool(graph.right_change[0]) is allowed
    for i, key in enumerate(keys):
        stations = [network.get_lane(key[:3]).local_coordinates(p * [1.0, -1.0]) for p in np.asarray(graph.centre[i])]
        assert np.abs(np.array(stations)[:, 1]).max() < 0.15


def test_bad_networks_are_refused():
    from highway_env.road.lane import StraightLane
    from highway_env.road.road import RoadNetwork

    with pytest.raises(RoadError, match="network is empty"):
        read_network(RoadNetwork())
    network = RoadNetwork()
    network.add_lane("a", "b", StraightLane([0.0, 0.0], [np.nan, 0.0]))
    with pytest.raises(RoadError, match="not a positive number"):
        read_network(network)
    with pytest.raises(ConfigError, match="no highway-env environment 'higway-v0'"):
        open_environment("higway-v0")
