"""Places with a guess of their station: found again, and told which lanes they lie in."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.roadmap import builders
from urbanjax.roadmap.builders.specs import RoadStyle
from urbanjax.roadmap.nearby import lanes_at, nearby, thinned
from urbanjax.roadmap.progress import sample, to_world


@pytest.fixture(scope="module")
def bend(extend_along):
    """A left bend of radius 30 m on the rightmost of two lanes."""
    graph = builders.curve(radius=30.0, angle=1.8, n_lanes=2, style=RoadStyle(n_points=16))
    return extend_along(graph, 1, int(np.flatnonzero(np.asarray(graph.has_left))[-1]))


def places(road, n=60):
    rng = np.random.default_rng(0)
    station = jnp.asarray(rng.uniform(5, float(road.length) - 5, n), jnp.float32)
    offset = jnp.asarray(rng.uniform(-2.0, 5.0, n), jnp.float32)
    return station, offset, to_world(road, station, offset=offset)[0]


def test_stations_are_found_from_a_few_metres_off(bend):
    station, _, position = places(bend)
    guess = station + jnp.asarray(np.random.default_rng(1).uniform(-3, 3, station.shape), jnp.float32)
    np.testing.assert_allclose(jax.jit(nearby)(bend, position, station=guess), station, atol=5e-3)


def test_lanes_are_told_by_their_borders(bend):
    station, offset, position = places(bend)
    there = jax.jit(lanes_at)(bend, position, station=station)
    at = sample(bend, station)
    margin = np.asarray(at.lane_width) / 2 - np.abs(np.asarray(offset)[:, None] - np.asarray(at.lane_offset))
    clear = np.abs(margin) > 0.05
    expected = (margin > 0) & np.asarray(at.has_lane)
    np.testing.assert_array_equal(np.asarray(there.inside)[clear], expected[clear])
    assert expected.any(axis=0).sum() == 2
    assert not np.asarray(there.oncoming).any()


def test_oncoming_lanes_are_told(graphs, extend_along):
    road = extend_along(builders.two_way(1, 1, length=100.0), 0, 0)
    offset = jnp.asarray([0.0, 3.5, 9.0])
    station = jnp.full(3, 50.0)
    there = lanes_at(road, to_world(road, station, offset=offset)[0], station=station)
    assert np.asarray(there.inside).any(axis=1).tolist() == [True, True, False]
    assert np.asarray(there.oncoming).any(axis=1).tolist() == [False, True, False]


def test_a_thinned_corridor_is_the_same_road(bend):
    station, offset, position = places(bend)
    found = to_world(thinned(bend, 4), station, offset=offset)[0]
    np.testing.assert_allclose(found, position, atol=0.02)
