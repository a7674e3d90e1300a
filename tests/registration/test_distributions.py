"""Maps of distributions hold the means and covariances of the points of each voxel."""

import jax.numpy as jnp
import numpy as np
import pytest

from tests.registration.conftest import MAP
from urbanjax.types import as_arrays


@pytest.mark.parametrize("method", ["vgicp", "ndt"])
def test_voxels_hold_mean_and_covariance_of_their_points(method, pair, build_jit):
    target = pair[1]
    world = build_jit(target, as_arrays(MAP.replace(method=method)))
    points, shapes = np.asarray(target.position, float).T, np.asarray(target.covariance, float).T
    cells = np.floor(points / 2.0).astype(int)
    origin = np.asarray(world.origin)
    assert np.allclose(origin % 2.0, 0)
    checked = 0
    for cell in np.unique(cells, axis=0):
        inside = np.all(cells == cell, axis=1)
        x, y, z = (cell - np.round(origin / 2.0)).astype(int)
        row = np.asarray(world.rows[int(world.table[(x * 32 + y) * 8 + z])])
        if method == "ndt" and inside.sum() < 6:
            assert row[9] == 0
            continue
        np.testing.assert_allclose(row[:3] + origin, points[inside].mean(0), atol=1e-4)
        assert row[9] == inside.sum()
        if method == "vgicp":
            np.testing.assert_allclose(row[3:9], shapes[inside].mean(0), atol=1e-5)
        else:
            low, vectors = np.linalg.eigh(np.cov(points[inside].T))
            raised = vectors @ np.diag(np.maximum(low, 0.01 * low[-1])) @ vectors.T
            np.testing.assert_allclose(row[3:9], raised[np.triu_indices(3)], atol=2e-4)
        checked += 1
    assert checked > 60


def test_points_outside_the_window_and_invalid_ones_are_left_out(pair, build_jit):
    target = pair[1]
    some = target.replace(valid=target.valid.at[::2].set(False))
    world = build_jit(some, as_arrays(MAP))
    assert float(world.rows[:-1, 9].sum()) == int(some.valid.sum())
    assert int(world.left_out) == 0
    outside = build_jit(target, as_arrays(MAP), centre=jnp.array([1e4, 0.0, 0.0]))
    assert float(outside.rows[:-1, 9].sum()) == 0
    assert int(outside.left_out) == int(target.valid.sum())
