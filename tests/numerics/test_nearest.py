"""Nearest neighbours equal scipy's tree wherever they are certified, and the certificate tells the truth."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import cKDTree

from urbanjax.numerics import nearest

search = jax.jit(nearest.nearest, static_argnames=("k", "visits"))


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("visits", [12, 1000])
def test_certified_neighbours_are_the_nearest(d, visits):
    rng = np.random.default_rng(d)
    points = np.concatenate([rng.normal(size=(1500, d)), 0.02 * rng.normal(size=(200, d)) + 3, rng.normal(size=(7, d))])
    points = rng.permutation(points.astype(np.float32))
    valid = np.arange(len(points)) < 1700
    found = search(jnp.asarray(points.T), jnp.asarray(valid), k=6, visits=visits)
    order = np.asarray(found.order)
    assert np.array_equal(np.sort(order), np.arange(len(points)))
    assert np.all(order[:1700] < 1700)
    points = points[order][:1700]
    expected, _ = cKDTree(points).query(points, 6)
    exact = np.asarray(found.exact)[:1700]
    distance = np.sqrt(np.asarray(found.squared).T[:1700])
    np.testing.assert_allclose(distance[exact], expected[exact], rtol=5e-4, atol=1e-5)
    assert np.all(distance >= expected * (1 - 5e-4) - 1e-5)
    assert exact.all() if visits == 1000 else 0.05 < exact.mean() < 1
    index = np.asarray(found.index).T[:1700]
    away = np.linalg.norm(points[index] - points[:, None], axis=-1)
    np.testing.assert_allclose(away, distance, rtol=5e-4, atol=1e-5)
    assert np.all(index[:, 0] == np.arange(1700))
    assert all(len(set(row)) == 6 for row in index)


def test_a_tree_of_four_levels_misses_few_neighbours():
    rng = np.random.default_rng(0)
    u, v = rng.uniform(-1, 1, (2, 5000))
    points = np.stack([40 * u, 30 * v, np.sin(9 * u) + 0.01 * rng.normal(size=5000)]).astype(np.float32)
    found = search(jnp.asarray(points), jnp.ones(5000, bool), k=10, visits=24)
    tree = cKDTree(points.T[np.asarray(found.order)])
    expected, _ = tree.query(tree.data, 10)
    right = np.isclose(np.sqrt(np.asarray(found.squared)[-1]), expected[:, -1], rtol=1e-4)
    assert right.mean() > 0.97
    assert right[np.asarray(found.exact)].all()


def test_fewer_points_than_asked_for():
    points = np.random.default_rng(0).normal(size=(3, 40)).astype(np.float32)
    found = search(jnp.asarray(points), jnp.arange(40) < 3, k=5, visits=4)
    assert np.isinf(np.asarray(found.squared)[3:, :3]).all()
    assert np.isfinite(np.asarray(found.squared)[:3, :3]).all()
    assert np.array_equal(np.asarray(found.index)[3:], np.tile(np.arange(40), (2, 1)))


def test_many_copies_of_one_point_are_apart_by_nothing():
    found = search(jnp.ones((3, 300)), jnp.ones(300, bool), k=4, visits=8)
    assert float(found.squared.max()) < 1e-12


def test_a_batch_of_clouds_equals_the_clouds_one_by_one():
    points = np.random.default_rng(0).normal(size=(2, 3, 300)).astype(np.float32)
    valid = np.arange(300) < np.array([[300], [20]])
    together = jax.jit(jax.vmap(lambda p, v: nearest.nearest(p, v, k=4, visits=8)))(points, valid)
    for i in range(2):
        alone = search(points[i], valid[i], k=4, visits=8)
        held = valid[i].sum()
        np.testing.assert_array_equal(together.index[i][:, :held], alone.index[:, :held])
        np.testing.assert_array_equal(together.exact[i][:held], alone.exact[:held])
