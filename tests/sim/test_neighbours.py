"""Leaders and followers against a search by plain Python."""

import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.roadmap.builders import intersection
from urbanjax.sim import lanes as roads
from urbanjax.sim.neighbours import FAR, Bodies, ahead, behind, look_ahead, nearest


@pytest.fixture(scope="module")
def scene():
    graph = intersection(signalised=False, n_lanes=2, leg=80.0)
    lanes = roads.from_graph(graph)
    rng = np.random.default_rng(0)
    n = 60
    link = rng.integers(0, graph.length.shape[0], n)
    station = rng.uniform(0, np.asarray(graph.length)[link])
    exists = rng.uniform(size=n) < 0.8
    route = rng.integers(0, 5, n)
    return graph, lanes, link, station, exists, route


def chain_of(graph, link, station, route, n_links):
    """[(link, distance to its start)], as a driver would list them."""
    out = [(int(link), -float(station))]
    while len(out) < n_links:
        last, start = out[-1]
        following = [int(j) for j, ok in zip(graph.successor[last], graph.has_successor[last], strict=True) if ok]
        if not following:
            break
        out.append((following[int(route) % len(following)], start + float(graph.length[last])))
    return out


def test_equals_plain_search(scene):
    graph, lanes, link, station, exists, route = scene
    n = len(link)
    place = jnp.asarray(link, jnp.int32), jnp.asarray(station, jnp.float32)
    chain = look_ahead(
        lanes, place[0], station=place[1], choice=jnp.asarray(route, jnp.int32), exists=jnp.asarray(exists), n_links=3
    )
    speed = jnp.asarray(np.random.default_rng(1).uniform(0, 10, n), jnp.float32)
    at = jnp.where(jnp.asarray(exists), place[1], -FAR)
    bodies = Bodies(place[0], at, place[0], jnp.full(n, -FAR), jnp.full(n, 2.0), speed)
    seen = jnp.asarray(exists)[:, None] & ~jnp.eye(n, dtype=bool)
    front = nearest(ahead(chain, bodies, seen=seen), bodies, half=bodies.half)
    back = nearest(behind(chain, bodies.link, station=at, seen=seen), bodies, half=bodies.half)

    distance = np.full((n, n), np.inf)  # [driver, vehicle]
    for i in np.flatnonzero(exists):
        for onto, start in chain_of(graph, link[i], station[i], route[i], 3):
            for j in np.flatnonzero(exists & (link == onto)):
                if i != j and start + station[j] >= 0:
                    distance[i, j] = min(distance[i, j], start + station[j])
    assert np.isfinite(distance).sum() > 60
    for found, expected in ((front, distance), (back, distance.T)):
        for i in np.flatnonzero(exists):
            assert bool(found.exists[i]) == np.isfinite(expected[i]).any()
            if found.exists[i]:
                np.testing.assert_allclose(found.gap[i], expected[i].min() - 4.0, atol=1e-3)
                assert int(found.index[i]) == expected[i].argmin()
                assert float(found.speed[i]) == float(speed[found.index[i]])


def test_absent_vehicles_see_and_are_seen_by_nobody(scene):
    _, lanes, link, station, _, route = scene
    n = len(link)
    nobody = jnp.zeros(n, bool)
    links = jnp.asarray(link, jnp.int32)
    chain = look_ahead(
        lanes,
        links,
        station=jnp.asarray(station, jnp.float32),
        choice=jnp.asarray(route, jnp.int32),
        exists=nobody,
        n_links=3,
    )
    far = jnp.full(n, -FAR)
    bodies = Bodies(links, far, links, far, jnp.full(n, 2.0), jnp.zeros(n))
    found = nearest(ahead(chain, bodies, seen=~jnp.eye(n, dtype=bool)), bodies, half=bodies.half)
    assert not bool(found.exists.any())
    assert np.all(np.asarray(found.gap) == FAR)


def test_side_by_side_is_not_overlooked(scene):
    _, lanes, *_ = scene
    links, station = jnp.zeros(2, jnp.int32), jnp.asarray([20.0, 20.0])
    chain = look_ahead(lanes, links, station=station, choice=links, exists=jnp.ones(2, bool), n_links=2)
    bodies = Bodies(links, station, links, jnp.full(2, -FAR), jnp.full(2, 2.0), jnp.asarray([3.0, 5.0]))
    found = nearest(ahead(chain, bodies, seen=~jnp.eye(2, dtype=bool)), bodies, half=bodies.half)
    np.testing.assert_allclose(found.gap, [-4.0, -4.0])
    np.testing.assert_allclose(found.speed, [5.0, 3.0])
