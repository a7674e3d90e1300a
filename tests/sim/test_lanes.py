import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.roadmap.builders import curve, merge
from urbanjax.roadmap.builders.specs import RoadStyle
from urbanjax.sim import lanes as roads


def test_curve_is_a_circle_and_lanes_are_parallel():
    graph = curve(radius=30.0, angle=np.pi / 2, n_lanes=2, lead=40.0, transition=10.0, style=RoadStyle(section=25.0))
    lanes = roads.from_graph(graph)
    index = int(np.argmax(np.abs(graph.curvature).min(axis=1)))  # a link inside the arc
    links = jnp.full(50, index, jnp.int32)
    row = roads.at(lanes, links, station=jnp.linspace(0.0, float(graph.length[index]), 50))
    x, y, radius = np.asarray(row[:, 0]), np.asarray(row[:, 1]), 1 / float(graph.curvature[index].mean())
    centre = np.linalg.lstsq(np.c_[2 * x, 2 * y, np.ones(50)], x * x + y * y, rcond=None)[0]
    np.testing.assert_allclose(np.hypot(x - centre[0], y - centre[1]), radius, atol=0.01)
    column = roads.LEFT_DISTANCE if bool(graph.has_left[index]) else roads.RIGHT_DISTANCE
    np.testing.assert_allclose(np.abs(row[:, column]), 3.5, atol=0.01)


def test_place_inverts_at(road):
    lanes = road.lanes
    links = jnp.asarray([0, 1, 5], jnp.int32)
    found = jax.jit(roads.place)(lanes, links, position=jnp.asarray([100.0, 0.4]))
    np.testing.assert_allclose(found.station[:2], 100.0, atol=1e-3)
    np.testing.assert_allclose(found.offset[:2], [0.4 - 3.5, 0.4], atol=1e-5)
    assert found.station[2] == 0
    assert found.distance[2] > 300


def test_gradient_of_place_is_along_the_road(road):
    def station(position):
        return roads.place(road.lanes, jnp.asarray([1], jnp.int32), position=position).station[0]

    np.testing.assert_allclose(jax.jit(jax.grad(station))(jnp.asarray([101.0, 0.4])), [1.0, 0.0], atol=1e-5)


def test_lane_that_ends_beside_another_is_known():
    graph = merge()
    lanes = roads.from_graph(graph)
    last = np.flatnonzero(np.asarray(lanes.n_successors == 0))
    ends = np.flatnonzero(np.asarray(lanes.ends))
    assert len(ends) == 1
    assert set(ends) < set(last)
    assert bool(graph.has_left[ends[0]])
    assert lanes.has_conflicts == bool((graph.has_predecessor.sum(1) > 1).any())
