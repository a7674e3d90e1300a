"""Nearest neighbours equal scipy's tree wherever they are certified, and the certificate tells the truth."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import cKDTree

from urbanjax.numerics import nearest

search = jax.jit(nearest.nearest, static_argnums=(2, 3, 4))


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("visits", [20, 1000])
def test_certified_neighbours_are_the_nearest(d, visits):
    rng = np.random.default_rng(d)
    points = np.concatenate([rng.normal(size=(500, d)), 0.02 * rng.normal(size=(200, d)) + 3, rng.normal(size=(7, d))])
    points = points.astype(np.float32)
    valid = np.arange(len(points)) < 700
    found = search(jnp.asarray(points.T), jnp.asarray(valid), 6, 16, visits)
    expected, _ = cKDTree(points[:700]).query(points[:700], 6)
    exact = np.asarray(found.exact)[:700]
    distance = np.sqrt(np.asarray(found.squared)[:700])
    np.testing.assert_allclose(distance[exact], expected[exact], rtol=1e-4, atol=1e-5)
    assert np.all(distance >= expected - 1e-5)
    assert exact.all() if visits == 1000 else 0.05 < exact.mean() < 1
    index = np.asarray(found.index)[:700]
    away = np.linalg.norm(points[index] - points[:700, None], axis=-1)
    np.testing.assert_allclose(away, distance, rtol=1e-4, atol=1e-5)
    assert np.all(index[:, 0] == np.arange(700))


def test_fewer_points_than_asked_for():
    points = np.random.default_rng(0).normal(size=(3, 40)).astype(np.float32)
    found = search(jnp.asarray(points), jnp.arange(40) < 3, 5, 16, 4)
    assert np.isinf(np.asarray(found.squared)[:3, 3:]).all()
    assert np.isfinite(np.asarray(found.squared)[:3, :3]).all()


def test_reach_holds_k_candidates():
    points = np.random.default_rng(1).normal(size=(3, 320)).astype(np.float32)
    blocks = jax.jit(nearest.arrange, static_argnums=(2, 3))(points, np.ones(320, bool), 16, 20)
    squared = jax.jit(nearest.distances)(blocks)
    bound = jax.jit(nearest.reach, static_argnums=1)(squared, 10)
    held = np.sum(np.asarray(squared) <= np.asarray(bound)[..., None], axis=-1)
    assert held.min() == 10
    assert np.mean(held == 10) > 0.95
    assert np.isinf(jax.jit(nearest.reach, static_argnums=1)(squared[:, :, :9], 10)).all()
