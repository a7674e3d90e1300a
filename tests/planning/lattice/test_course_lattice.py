"""The lattice of a whole course: geometry, limits, window, and the cheapest way through it against Dijkstra."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.racetrack.study import BARRED, dijkstra, log_paths
from urbanjax.course import course_between
from urbanjax.io.maps import racetrack
from urbanjax.io.maps.racetrack import Racetrack
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning.lattice import course_lattice
from urbanjax.planning.lattice.course_lattice import CourseLatticeParams, SlideParams, sized, slide
from urbanjax.planning.lattice.course_path import driven
from urbanjax.planning.lattice.search import closed_search
from urbanjax.roadmap import builders
from urbanjax.roadmap.builders.specs import RoadStyle
from urbanjax.roadmap.corridor import CorridorParams
from urbanjax.types import RoadError, as_arrays
from urbanjax.vehicle.params import VehicleParams

FEW = CorridorParams(lanes=1, n_stations=512)
COARSE = CourseLatticeParams(straight_spacing=14.0, bend_spacing=9.0, lateral_spacing=1.6)
BUILD = jax.jit(course_lattice.build)
SLIDE, SEARCH = jax.jit(slide), jax.jit(closed_search)


def circuit(position, right, left):
    """The course once round a track given by its points."""
    n = len(position)
    track = Racetrack(position, np.broadcast_to(right, n), np.broadcast_to(left, n), np.arange(n), closed=True)
    found = racetrack.road_map(Path("made up"), track)
    return course_between(found.graph, 0, goal=len(found.ids) - 1, corridor=FEW)


def built(course, params=COARSE, relaxation=None):
    """The lattice of a course and the parameters it took."""
    params = sized(course.corridor, params)
    relaxation = as_arrays(relaxation or Relaxation())
    return BUILD(course.corridor, as_arrays(VehicleParams()), params=as_arrays(params), relaxation=relaxation), params


@pytest.fixture(scope="module")
def winding():
    """A circuit with bends to both sides and a width that varies."""
    angle = np.linspace(0, 2 * np.pi, 160, endpoint=False)
    reach = 50 * (1 + 0.2 * np.cos(2 * angle) + 0.12 * np.sin(3 * angle))
    return circuit(
        reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1),
        4.0 + np.sin(3 * angle),
        4.0 - 0.8 * np.cos(angle),
    )


@pytest.fixture(scope="module")
def lattice(winding):
    return built(winding)[0]


@pytest.fixture(scope="module")
def circle():
    """Radius 40 m, 5 m wide to both sides, driven to the left."""
    angle = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    return built(circuit(40 * np.stack([np.cos(angle), np.sin(angle)], -1), 5.0, 5.0))[0]


def test_layers_go_once_round_and_lie_closer_in_bends(winding, lattice):
    assert lattice.closed
    np.testing.assert_allclose(jnp.sum(lattice.spacing), winding.corridor.length, rtol=1e-5)
    np.testing.assert_allclose(lattice.station[1:], jnp.cumsum(lattice.spacing)[:-1], rtol=1e-4)
    assert float(lattice.spacing.max()) <= COARSE.straight_spacing
    bend = np.abs(np.interp(lattice.station, winding.corridor.station, winding.corridor.curvature))
    assert np.max(np.asarray(lattice.spacing)[bend > 0.015]) < COARSE.bend_spacing + 1.0


def test_on_a_circle_nodes_and_lengths_are_known(circle):
    place = np.asarray(circle.position)
    middle = place.reshape(-1, 2).mean(0)
    radius = np.linalg.norm(place - middle, axis=-1)
    np.testing.assert_allclose(radius, 40.0 - np.asarray(circle.offset), atol=0.02)
    np.testing.assert_allclose(circle.curvature, 1 / radius, rtol=5e-3)
    outward = (place - middle) / radius[..., None]
    heading = np.stack([np.cos(circle.heading), np.sin(circle.heading)], -1)
    np.testing.assert_allclose(np.sum(outward * heading, -1), 0, atol=5e-3)
    for k in (1, 3, 5):
        round_trip = float(jnp.sum(circle.length[:, k, k]))
        assert round_trip == pytest.approx(2 * np.pi * radius[:, k].mean(), rel=1e-3)
    assert np.all(np.asarray(circle.length)[:, 5, 5] < np.asarray(circle.length)[:, 1, 1])


def test_the_shortest_way_round_a_circle_is_its_innermost(circle):
    _, nodes, _ = SEARCH(jnp.where(circle.edge > 0.5, circle.length, 1e5), as_arrays(Relaxation()))
    innermost = np.max(np.where(np.asarray(circle.node) > 0.5, np.arange(circle.node.shape[1]), -1), axis=1)
    np.testing.assert_array_equal(np.asarray(nodes).argmax(1), innermost)


def test_nodes_and_edges_keep_the_footprint_on_the_track(lattice):
    room = np.abs(np.asarray(lattice.offset)) + 0.95
    width = (
        np.asarray(lattice.offset[:, -1] - lattice.offset[:, 0]) * lattice.node.shape[1] / (lattice.node.shape[1] - 1)
    )
    there = np.asarray(lattice.node) > 0.5
    assert np.all((room <= width[:, None] / 2 + 1e-3)[there])
    assert np.all((room >= width[:, None] / 2 - 1e-3)[~there])
    assert 0.5 < there.mean() < 1
    edge = np.asarray(lattice.edge) > 0.5
    assert not np.any(edge & ~there[:, :, None])
    assert not np.any(edge & ~np.roll(there, -1, axis=0)[:, None, :])


def test_no_edge_is_sharper_than_the_limit(winding):
    params = COARSE.replace(limits=COARSE.limits.replace(max_curvature=0.06))
    sharp, blunt = built(winding)[0], built(winding, params)[0]
    kept = np.asarray(blunt.edge) > 0.5
    assert float(np.asarray(blunt.greatest)[kept].max()) <= 0.06
    gone = (np.asarray(sharp.edge) > 0.5) & ~kept
    assert gone.sum() > 50
    assert float(np.asarray(sharp.greatest)[gone].min()) > 0.06


def test_closed_search_is_dijkstra_on_the_same_edges(lattice, x64):
    length, bending, edge = (np.asarray(x, float) for x in (lattice.length, lattice.bending, lattice.edge))
    for weight in (0.0, 300.0):
        cost = np.where(edge > 0.5, length + weight * bending, BARRED)
        value, nodes, edges = SEARCH(jnp.asarray(cost), Relaxation())
        assert float(value) == pytest.approx(dijkstra(cost, closed=True), abs=1e-8)
        assert np.sum(cost[np.asarray(edges) > 0.5]) == pytest.approx(float(value), abs=1e-8)
        np.testing.assert_array_equal(np.sum(nodes, axis=1), 1)


def test_the_soft_value_is_bounded_and_its_gradient_is_the_edge_marginals(lattice, x64):
    relaxation, temperature = Relaxation(0.7, mode="soft"), 0.7
    cost = np.where(np.asarray(lattice.edge) > 0.5, np.asarray(lattice.length, float), BARRED)
    hard = float(SEARCH(jnp.asarray(cost), Relaxation())[0])

    @jax.jit
    def search(cost):
        def value(cost):
            value, nodes, edges = closed_search(cost, relaxation)
            return value, (nodes, edges)

        return jax.value_and_grad(value, has_aux=True)(cost)

    (value, (nodes, edges)), slope = search(jnp.asarray(cost))
    assert hard - temperature * log_paths(cost, closed=True) <= float(value) <= hard
    np.testing.assert_allclose(slope, edges, atol=1e-10)
    np.testing.assert_allclose(np.sum(nodes, axis=1), 1, atol=1e-10)
    np.testing.assert_allclose(np.sum(edges, axis=1), np.roll(nodes, -1, axis=0), atol=1e-10)
    for place in np.argwhere(np.asarray(edges) > 0.05)[:3]:
        moved = np.zeros_like(cost)
        moved[tuple(place)] = 1e-4
        ends = [float(search(jnp.asarray(cost + s * moved))[0][0]) for s in (1, -1)]
        assert (ends[0] - ends[1]) / 2e-4 == pytest.approx(float(edges[tuple(place)]), rel=1e-5)


def test_a_window_reads_what_the_whole_lattice_says(lattice):
    size, course = lattice.station.shape[0], float(lattice.course)
    params = as_arrays(SlideParams(behind=20.0, n_layers=7))
    for station in (0.0, 100.0, course - 5.0, course + 30.0, 2 * course + 1.0):
        part = SLIDE(lattice, jnp.asarray(station), params=params)
        lap = np.floor((np.asarray(part.station) + 1e-3) / course)
        index = np.array([np.argmin(np.abs(np.asarray(lattice.station) - s)) for s in part.station - lap * course])
        np.testing.assert_array_equal(np.diff(index) % size, 1)
        np.testing.assert_allclose(part.station, np.asarray(lattice.station)[index] + lap * course, rtol=1e-6)
        assert part.station[0] <= station - 20.0 + 1e-3 < part.station[1]
        assert np.all(np.diff(part.station) > 0)
        for name in ("position", "heading", "offset", "node", "edge", "length", "greatest", "spacing"):
            np.testing.assert_array_equal(getattr(part, name), np.asarray(getattr(lattice, name))[index])


def test_a_path_is_smooth_in_the_plane_and_as_long_as_its_edges(winding, lattice):
    rng = np.random.default_rng(1)
    cost = jnp.where(lattice.edge > 0.5, lattice.length + jnp.asarray(rng.uniform(0, 8, lattice.edge.shape)), 1e5)
    _, nodes, edges = SEARCH(cost, as_arrays(Relaxation()))
    chosen, samples = np.asarray(nodes).argmax(1), 400
    path = jax.tree.map(np.asarray, driven(winding.corridor, lattice, nodes=jnp.asarray(chosen), samples=samples))
    chords = np.diff(np.concatenate([path.position, path.position[:1]])[::10], axis=0)
    picked = np.asarray(edges) > 0.5
    assert np.linalg.norm(chords, axis=-1).sum() == pytest.approx(np.asarray(lattice.length)[picked].sum(), rel=2e-3)
    layers = np.arange(len(chosen))
    for name, near in (("heading", 0.01), ("curvature", 0.02)):
        node, along = np.asarray(getattr(lattice, name))[layers, chosen], getattr(path, name)
        np.testing.assert_allclose(along[::samples], node, atol=1e-4)
        np.testing.assert_allclose(np.sin(along[samples - 1 :: samples] - np.roll(node, -1)), 0, atol=near)
    turned = np.arctan2(chords[:, 1], chords[:, 0]) - path.heading[5::10]
    np.testing.assert_allclose(np.sin(turned), 0, atol=0.04)
    # The table's own headings and curvatures agree to a few 1/km.
    assert np.abs(path.curvature).max() <= np.asarray(lattice.greatest)[picked].max() + 0.01


def test_an_open_road_has_no_edges_beyond_its_end_and_none_over_a_solid_line():
    graph = builders.curve(radius=60.0, angle=1.0, n_lanes=2, lead=40.0, style=RoadStyle(section=200.0))
    course = course_between(
        graph, 1, goal=int(np.flatnonzero(np.asarray(graph.has_left))[-1]), corridor=CorridorParams(lanes=3)
    )
    open_road, params = built(course)
    assert not params.closed
    assert not np.any(open_road.edge[-1])
    lane, there = np.asarray(open_road.lane[0]), np.asarray(open_road.node) > 0.5
    assert set(lane[there.any(0)]) == {1, 2}
    across = lane[:, None] != lane[None, :]
    assert np.any(np.asarray(open_road.edge)[:, across] > 0)
    solid = graph.replace(left_change=0 * graph.left_change > 0, right_change=0 * graph.left_change > 0)
    barred = built(
        course_between(
            solid, 1, goal=int(np.flatnonzero(np.asarray(graph.has_left))[-1]), corridor=CorridorParams(lanes=3)
        )
    )[0]
    assert not np.any(np.asarray(barred.edge)[:, (lane[:, None] == 1) & (lane[None, :] == 2)])
    part = SLIDE(open_road, jnp.asarray(1e4), params=SlideParams(n_layers=6))
    np.testing.assert_array_equal(part.station, open_road.station[-6:])


def test_degrees_become_hard_as_the_temperature_falls(winding, lattice):
    cold = built(winding, relaxation=Relaxation(1e-3, mode="soft"))[0]
    np.testing.assert_allclose(cold.node, lattice.node, atol=1e-4)
    assert np.mean(np.abs(np.asarray(cold.edge - lattice.edge)) > 1e-3) < 1e-3  # but for exact ties
    warm = built(winding, relaxation=Relaxation(1.0, mode="soft"))[0]
    assert np.any((np.asarray(warm.edge) > 0.1) & (np.asarray(warm.edge) < 0.9))


def test_single_precision_is_enough(winding, lattice):
    with jax.enable_x64(True):
        double = jax.tree.map(lambda x: x.astype(float) if x.dtype == jnp.float32 else x, winding)
        exact = built(double)[0]
    np.testing.assert_allclose(lattice.position, exact.position, atol=2e-3)
    np.testing.assert_allclose(lattice.length, exact.length, atol=2e-3)
    np.testing.assert_allclose(lattice.greatest, exact.greatest, atol=2e-4)
    assert np.mean(np.asarray(lattice.edge) != np.asarray(exact.edge)) < 1e-3


def test_impossible_sizes_are_refused(winding, lattice):
    with pytest.raises(RoadError, match="spacings and bend_curvature must be positive"):
        sized(winding.corridor, COARSE.replace(bend_spacing=0.0))
    with pytest.raises(RoadError, match="raise its spacings"):
        sized(winding.corridor, COARSE.replace(lateral_spacing=0.01, bend_spacing=0.1))
    with pytest.raises(RoadError, match="2 layers or more"):
        course_lattice.build(
            winding.corridor, VehicleParams(), params=COARSE.replace(n_layers=1), relaxation=Relaxation()
        )
    with pytest.raises(RoadError, match="longer than the lattice"):
        slide(lattice, jnp.asarray(0.0), params=SlideParams(n_layers=1000))
