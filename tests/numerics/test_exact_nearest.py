"""No neighbour is in doubt: all equal scipy's tree, whatever the densities of queries and points."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import cKDTree

from urbanjax.numerics import tree as trees
from urbanjax.numerics.exact_nearest import nearest_among

N, K = 3000, 6


@pytest.fixture(scope="module")
def search():
    def both(queries, points, asked, valid):
        depth = trees.depth(queries.shape[0])
        return nearest_among(
            trees.build(queries.T, asked, levels=depth), trees.build(points.T, valid, levels=depth), k=K
        )

    return jax.jit(both)


def along_a_curve(rng):
    angle = rng.uniform(0, 2 * np.pi, N)
    return np.stack([50 * np.cos(angle), 30 * np.sin(2 * angle)], axis=1) + 0.01 * rng.normal(size=(N, 2))


def dense(shift):
    """A quarter of a circle of 10 m at 5 mm: its points are nearly equally far from what is beside it."""
    angle = np.arange(N) * 0.0005
    return np.stack([10 * np.cos(angle) + shift, 10 * np.sin(angle)], axis=1)


SETS = {
    "alike": lambda rng: (rng.normal(size=(N, 2)), rng.normal(size=(N, 2))),
    "among few": lambda rng: (0.1 * rng.normal(size=(N, 2)), 5 * rng.normal(size=(N, 2))),
    "among many": lambda rng: (5 * rng.normal(size=(N, 2)), 0.1 * rng.normal(size=(N, 2))),
    "apart": lambda rng: (rng.normal(size=(N, 2)), rng.normal(size=(N, 2)) + 40),
    "along a curve": lambda rng: (along_a_curve(rng), along_a_curve(rng)),
    "regular": lambda rng: (np.stack([np.arange(N), np.zeros(N)], 1), np.stack([np.arange(N) + 0.25, np.ones(N)], 1)),
    "far from a dense curve": lambda rng: (dense(2.0), dense(0.0)),
    "one place": lambda rng: (rng.normal(size=(N, 2)), np.ones((N, 2))),
}


@pytest.mark.parametrize("name", SETS)
def test_neighbours_of_every_query_are_the_nearest(search, name):
    rng = np.random.default_rng(0)
    queries, points = (x.astype(np.float32) for x in SETS[name](rng))
    index, _ = search(queries, points, np.ones(N, bool), np.ones(N, bool))
    away = np.linalg.norm(queries[:, None].astype(float) - points[np.asarray(index).T], axis=-1)
    expected = cKDTree(points.astype(float)).query(queries.astype(float), K)[0]
    np.testing.assert_allclose(away, expected, rtol=1e-5, atol=1e-12)
    assert np.all(np.sort(index, axis=0)[1:] != np.sort(index, axis=0)[:-1])


def test_masks_leave_queries_and_points_out(search):
    rng = np.random.default_rng(1)
    queries, points = rng.normal(size=(2, N, 2)).astype(np.float32)
    asked, valid = rng.random((2, N)) < [[0.5], [0.1]]
    index = np.asarray(search(queries, points, asked, valid)[0]).T
    assert np.all(index[~asked] == N)
    assert valid[index[asked]].all()
    away = np.linalg.norm(queries[asked][:, None].astype(float) - points[index[asked]], axis=-1)
    np.testing.assert_allclose(away, cKDTree(points[valid]).query(queries[asked].astype(float), K)[0], rtol=1e-5)


def test_fewer_points_than_asked_for_are_all_found(search):
    queries, points = np.random.default_rng(2).normal(size=(2, N, 2)).astype(np.float32)
    index = np.asarray(search(queries, points, np.ones(N, bool), np.arange(N) < 2)[0])
    assert np.all(np.sort(index[:2], axis=0) == [[0], [1]])
    assert np.all(index[2:] == N)


def test_a_map_over_pairs_equals_the_pairs(search):
    rng = np.random.default_rng(3)
    queries, points = rng.normal(size=(2, 2, N, 2)).astype(np.float32)
    every = np.ones((2, N), bool)
    together, alone = jax.jit(lambda *x: jax.lax.map(lambda pair: search(*pair), x))(queries, points, every, every)
    for i in range(2):
        np.testing.assert_array_equal(together[i], search(queries[i], points[i], every[i], every[i])[0])
    assert jnp.all(alone < N)
