"""The corridor along a route, its window, its interpolation and the projection on it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.roadmap import builders
from urbanjax.roadmap.builders.specs import RoadStyle
from urbanjax.roadmap.corridor import CorridorParams, WindowParams, corridor_along, sized, window
from urbanjax.roadmap.graph import Turn
from urbanjax.roadmap.progress import progress
from urbanjax.roadmap.route import RouteParams, route_between
from urbanjax.types import RoadError

FEW = RouteParams(n_links=8)


@pytest.fixture(scope="module")
def changing(road, extend_along):
    """A route from the rightmost to the leftmost of three lanes, over two sections of 100 m."""
    return extend_along(road, 2, 3)


@pytest.fixture(scope="module")
def bend(extend_along):
    """A left bend of radius 30 m at the road's edge, on the rightmost of two lanes."""
    graph = builders.curve(radius=30.0, angle=1.8, n_lanes=2, style=RoadStyle(n_points=16))
    return extend_along(graph, 1, int(np.flatnonzero(np.asarray(graph.has_left))[-1]))


def distance_to_polyline(points, line):
    """Distance of each point to a polyline, by numpy."""
    a, d = line[:-1], np.diff(line, axis=0)
    r = points[:, None] - a[None]
    t = np.clip(np.sum(r * d, -1) / np.sum(d * d, -1), 0, 1)
    return np.linalg.norm(r - t[..., None] * d, axis=-1).min(1)


def test_stations_headings_and_curvatures_belong_to_one_curve(corridor_course):
    e = jax.tree.map(lambda x: np.asarray(x, float), corridor_course)
    step = np.diff(e.position, axis=0)
    np.testing.assert_allclose(np.linalg.norm(step, axis=-1), 1.0, atol=2e-3)
    middle = 0.5 * (e.heading[1:] + e.heading[:-1])
    np.testing.assert_allclose(np.sin(np.arctan2(step[:, 1], step[:, 0]) - middle), 0, atol=2e-3)
    np.testing.assert_allclose(np.diff(e.heading), 0.5 * (e.curvature[1:] + e.curvature[:-1]), atol=2e-3)


def test_course_has_the_length_of_its_links(corridor_course, district, course_links):
    assert float(corridor_course.length) == pytest.approx(
        float(np.sum(district.length[jnp.array(course_links)])), rel=1e-5
    )
    valid = np.asarray(corridor_course.valid)
    assert valid.sum() == int(corridor_course.length) + 1
    end = np.flatnonzero(valid)[-1]
    np.testing.assert_allclose(corridor_course.position[0], corridor_course.position[end], atol=1.0)


def test_lanes_land_on_the_lane_centres(corridor_course, district, to_world_jit):
    e = corridor_course
    has = np.asarray(e.has_lane) & np.asarray(e.valid)[:, None]
    assert set(has.sum(1)[np.asarray(e.valid)]) == {2, 3, 4}
    rows = np.random.default_rng(0).choice(np.flatnonzero(np.asarray(e.valid)), 60, replace=False)
    for q in range(e.lane_offset.shape[1]):
        points = np.asarray(to_world_jit(e, e.station, e.lane_offset[:, q])[0])
        for n in rows[has[rows, q]]:
            line = np.asarray(district.centre[e.lane_link[n, q]])
            assert distance_to_polyline(points[n][None], line)[0] < 0.06  # the sagitta of the tabulated arcs
    np.testing.assert_allclose(e.lane_offset[:, e.route_lane], 0, atol=1e-3)
    np.testing.assert_allclose(np.asarray(e.lane_width)[has], 3.5, atol=1e-3)


def test_stop_lines_are_listed_in_driving_order(corridor_course):
    n = int(np.sum(corridor_course.has_stop))
    assert np.asarray(corridor_course.stop_signal[:n]).tolist() == list(range(8))
    assert np.all(np.diff(corridor_course.stop_station[:n]) > 0)
    assert not np.any(corridor_course.has_stop[n:])


def test_turn_at_the_intersection_is_known(corridor_course, district):
    e = corridor_course
    left = np.asarray(e.turn) == Turn.LEFT
    assert 30 < left.sum() < 60
    turned = np.asarray(e.heading)[left]
    assert turned[-1] - turned[0] == pytest.approx(np.pi / 2, abs=0.1)


def test_laps_repeat_the_course(district, course_links, corridor_course, extend_district, sample_jit, progress_jit):
    e = extend_district(route_between(district, 0, goal=course_links[-1], laps=2))
    assert float(e.length) == pytest.approx(2 * float(corridor_course.length), rel=1e-5)
    length = float(e.length) / 2
    a, b = (sample_jit(e, jnp.linspace(20.0, 410.0, 50) + k * length) for k in (0.0, 1.0))
    assert np.all(e.valid)
    np.testing.assert_allclose(a.position, b.position, atol=5e-3)
    np.testing.assert_allclose(a.heading + 2 * np.pi, b.heading, atol=1e-4)
    for place in (a, b):  # a pose does not tell the lap: the first one is taken
        found = progress_jit(e, place.position, place.heading).station
        np.testing.assert_allclose(found, np.linspace(20.0, 410.0, 50), atol=0.02)


def test_lane_change_is_a_smooth_blend_of_the_stated_length(changing):
    e = changing
    y = np.asarray(e.position[:, 1])
    assert y[0] == pytest.approx(0.0)
    assert y[-1] == pytest.approx(7.0, abs=1e-3)
    assert float(e.length) > 200.0
    moving = np.flatnonzero(np.diff(y) > 1e-4)
    assert 50 < len(moving) <= 62
    assert np.max(np.abs(np.diff(np.asarray(e.heading)))) < 0.03
    assert np.max(np.abs(np.diff(np.asarray(e.curvature)))) < 0.01
    np.testing.assert_allclose(np.diff(e.heading), 0.5 * (e.curvature[1:] + e.curvature[:-1]), atol=1e-3)


def test_lanes_across_are_continuous_through_a_lane_change(changing):
    e = changing
    assert np.max(np.abs(np.diff(np.asarray(e.lane_offset), axis=0))) < 0.05
    np.testing.assert_allclose(e.lane_offset[:, e.route_lane], 0, atol=1e-4)
    has = np.asarray(e.has_lane)
    assert np.all(has[:, 2])
    assert has[0].tolist() == [False, False, True, True, True]
    assert has[-1].tolist() == [True, True, True, False, False]
    assert list(dict.fromkeys(np.asarray(e.lane_link)[:, 2].tolist())) in ([2, 5, 4, 3], [2, 1, 0, 3], [2, 1, 4, 3])


def test_route_continues_straight_beyond_its_end(bend):
    valid = np.asarray(bend.valid)
    assert not valid[-1]
    beyond = np.asarray(bend.position)[~valid]
    np.testing.assert_allclose(np.diff(beyond, axis=0, n=2), 0, atol=1e-4)
    np.testing.assert_allclose(np.asarray(bend.heading)[~valid], 1.8, atol=1e-4)
    assert np.all(np.asarray(bend.has_lane)[~valid] == np.asarray(bend.has_lane)[valid][-1])


def test_oncoming_lane_of_a_two_way_road_is_next_to_the_route(graphs, extend_along):
    e = extend_along(graphs["two_way"], 0, 0)
    valid = np.asarray(e.valid)
    assert np.asarray(e.has_lane)[valid].tolist() == [[False, False, True, True, False]] * valid.sum()
    assert np.asarray(e.oncoming)[valid].tolist() == [[False, False, False, True, False]] * valid.sum()
    assert np.asarray(e.change)[valid].tolist() == [[False, False, True, False]] * valid.sum()
    np.testing.assert_allclose(e.lane_offset[:, 3], 3.5, atol=1e-4)
    assert np.all(np.asarray(e.lane_link)[valid, 3] == 1)


def test_forbidden_overtaking_bars_the_oncoming_lane(extend_along):
    e = extend_along(builders.two_way(length=200.0, overtaking=False, style=RoadStyle(n_points=16)), 0, 0)
    assert np.all(np.asarray(e.has_lane)[:100, 3])
    assert not np.any(e.change)


def test_lane_that_coincides_with_an_oncoming_one_is_marked(graphs, extend_along):
    e = extend_along(graphs["coinciding"], 1, 1)
    assert np.asarray(e.has_lane)[10].tolist() == [False, False, True, True, False]
    assert np.asarray(e.oncoming)[10].tolist() == [False, False, False, True, False]
    assert int(e.lane_link[10, 3]) == 0
    assert bool(e.change[10, 2])


def test_lane_that_ends_is_gone(graphs, extend_along):
    graph = graphs["merge"]
    right = int(graph.left_link[graph.successor[int(np.argmax(graph.road_type == 2)), 0]])
    start, goal = int(graph.predecessor[right, 0]), int(graph.successor[right, 0])
    e = extend_along(graph, start, goal)
    has = np.asarray(e.has_lane)[:, 1]
    assert not has[:78].any()
    assert has[82:138].all()
    assert not has[143:].any()


def test_window_is_a_slice_of_the_whole(corridor_course, window_jit):
    params = WindowParams(behind=20.0, n_stations=64)
    for station, first in ((300.4, 280), (5.0, 0), (5212.0, 5192), (1e5, corridor_course.station.shape[0] - 64)):
        part = window_jit(corridor_course, jnp.asarray(station), params)
        assert float(part.station[0]) == first
        for name in ("station", "position", "heading", "lane_offset", "has_lane", "change", "valid", "turn"):
            np.testing.assert_array_equal(getattr(part, name), getattr(corridor_course, name)[first : first + 64])
        np.testing.assert_array_equal(part.stop_station, corridor_course.stop_station)


def test_what_is_read_does_not_depend_on_the_window(corridor_course, window_jit, sample_jit):
    station = jnp.linspace(310.0, 330.0, 41)
    a, b = (
        sample_jit(window_jit(corridor_course, jnp.asarray(s), WindowParams(behind=20.0, n_stations=64)), station)
        for s in (305.0, 322.7)
    )
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        np.testing.assert_allclose(x, y, atol=1e-4)


def test_sample_is_continuous_in_the_station(bend, sample_jit):
    fine = sample_jit(bend, jnp.linspace(-5.0, 270.0, 5501))
    for name, limit in (("position", 0.06), ("heading", 2e-3), ("curvature", 2e-3), ("lane_offset", 0.02)):
        assert np.max(np.abs(np.diff(np.asarray(getattr(fine, name)), axis=0))) < limit
    np.testing.assert_allclose(sample_jit(bend, jnp.asarray(50.0)).position, bend.position[50], atol=1e-5)


def test_world_to_route_and_back(bend, corridor_course, window_jit, progress_jit, to_world_jit):
    rng = np.random.default_rng(1)
    course = window_jit(corridor_course, jnp.asarray(340.0), WindowParams(behind=50.0, n_stations=256))
    for table, low, high in ((bend, 5.0, 200.0), (course, 300.0, 480.0)):
        station = jnp.asarray(rng.uniform(low, high, 64), jnp.float32)
        offset = jnp.asarray(rng.uniform(-8, 8, 64), jnp.float32)
        position, heading, _ = to_world_jit(table, station, offset)
        found = progress_jit(table, position, heading + 0.3)
        np.testing.assert_allclose(found.station, station, atol=1e-3)
        np.testing.assert_allclose(found.offset, offset, atol=1e-3)
        np.testing.assert_allclose(found.heading_error, 0.3, atol=1e-4)


def test_progress_beyond_the_ends_goes_on(bend, progress_jit, to_world_jit):
    station = jnp.array([-30.0, 280.0])
    position, heading, _ = to_world_jit(bend, station, jnp.array([1.0, -2.0]))
    found = progress_jit(bend, position, heading)
    np.testing.assert_allclose(found.station, station, atol=1e-3)
    np.testing.assert_allclose(found.offset, [1.0, -2.0], atol=1e-3)


def test_progress_tells_apart_two_directions_of_one_road(extend_along, progress_jit):
    """A hairpin of radius 4 m: near its legs the heading decides."""
    graph = builders.curve(radius=5.75, angle=np.pi, n_lanes=1, lead=60.0, transition=0.0, style=RoadStyle(n_points=16))
    e = extend_along(graph, 0, int(np.sum(graph.valid)) - 1)
    position = (e.position[30] + e.position[-1]) * jnp.array([0.0, 0.5]) + jnp.array([30.0, 0.3])
    found = progress_jit(e, jnp.stack([position, position]), jnp.array([0.0, np.pi]))
    assert float(found.station[0]) < 60 < 90 < float(found.station[1])


def test_progress_is_continuous_and_its_gradient_is_exact(bend, to_world_jit, x64):
    table = jax.tree.map(lambda x: jnp.asarray(x, float) if jnp.issubdtype(x.dtype, jnp.floating) else x, bend)

    @jax.jit
    def values(position):
        found = progress(table, position, heading=jnp.asarray(0.5))
        return jnp.stack([found.station, found.offset])

    start, _, _ = to_world_jit(table, jnp.asarray(62.3), jnp.asarray(2.5))
    line = start[None] + jnp.linspace(0, 3.0, 301)[:, None] * jnp.array([[0.8, 0.6]])
    moved = np.array([values(p) for p in line])
    assert np.max(np.abs(np.diff(moved, axis=0))) < 0.02
    jacobian = jax.jit(jax.jacobian(values))(start)
    step = 1e-5
    for k in range(2):
        shift = step * jnp.eye(2)[k]
        central = (values(start + shift) - values(start - shift)) / (2 * step)
        np.testing.assert_allclose(jacobian[:, k], central, rtol=1e-5, atol=1e-7)


def test_finite_at_the_centre_of_curvature(bend, sample_jit, to_world_jit):
    middle = 100.0
    at = sample_jit(bend, jnp.asarray(middle))
    centre, _, _ = to_world_jit(bend, jnp.asarray(middle), 1 / at.curvature)
    value, gradient = jax.jit(jax.value_and_grad(lambda p: progress(bend, p, heading=at.heading).station))(centre)
    assert np.isfinite(value)
    assert np.all(np.isfinite(gradient))


def test_sized_makes_room_for_the_route(district, course_links):
    route = route_between(district, 0, goal=course_links[-1])
    params = sized(district, route, params=CorridorParams())
    assert params.n_stations % 512 == 0
    assert params.n_stations > 5212 + 300
    assert params.n_stops >= 8


def test_even_number_of_lanes_across_is_refused(road):
    with pytest.raises(RoadError, match="lanes must be odd"):
        corridor_along(road, route_between(road, 2, goal=3, params=FEW), params=CorridorParams(lanes=4))


def test_window_is_batchable(bend, window_jit):
    params = WindowParams(n_stations=32)
    parts = jax.vmap(lambda station: window(bend, station, params=params))(jnp.array([60.0, 100.0]))
    np.testing.assert_allclose(parts.station[:, 0], [10.0, 50.0])


@pytest.mark.slow
def test_extend_is_batchable(road, changing):
    route = route_between(road, 2, goal=3, params=FEW)
    params = CorridorParams(n_stations=256, n_stops=4)
    both = jax.vmap(lambda blend: corridor_along(road, route, params=params.replace(blend_length=blend)))(
        jnp.array([30.0, 20.0])
    )
    np.testing.assert_allclose(both.position[0], changing.position, atol=1e-4)
