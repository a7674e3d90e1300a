"""Down-sampling is exact, whatever the hash does; normals are those of the nearest neighbours."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.registration.conftest import courtyard
from urbanjax import registration
from urbanjax.registration import cells
from urbanjax.registration.downsample import DownsampleParams, downsample, voxels
from urbanjax.registration.features import FeatureParams, features
from urbanjax.types import CloudError, as_arrays

downsample_jit = jax.jit(downsample)


def voxel_means(points: np.ndarray, size: float) -> np.ndarray:
    cells, inverse = np.unique(np.floor(points / size).astype(int), axis=0, return_inverse=True)
    sums = np.zeros((len(cells), 3))
    np.add.at(sums, inverse.ravel(), points)
    return sums / np.bincount(inverse.ravel())[:, None]


def ordered(points: np.ndarray) -> np.ndarray:
    return points[np.lexsort(np.round(points, 3).T)]


def test_voxel_means_equal_numpy():
    points = courtyard(2000, 0, noise=0.3)
    params = as_arrays(DownsampleParams(resolution=2.0, capacity=512))
    cloud, dropped = downsample_jit(jnp.asarray(points), jnp.ones(2000, bool), params=params)
    expected = voxel_means(points, 2.0)
    found = np.asarray(cloud.position).T[np.asarray(cloud.valid)]
    assert int(dropped) == 0
    assert len(found) == len(expected) == voxels(points, 2.0)
    np.testing.assert_allclose(ordered(found), ordered(expected), atol=1e-4)


def test_what_does_not_fit_is_counted_and_what_is_not_finite_does_not_count():
    points = courtyard(2000, 0)
    points[:5] = np.nan
    params = as_arrays(DownsampleParams(resolution=2.0, capacity=16))
    cloud, dropped = downsample_jit(jnp.asarray(points), jnp.ones(2000, bool).at[5:10].set(False), params=params)
    assert int(cloud.valid.sum()) == 16
    assert int(dropped) == len(voxel_means(points[10:], 2.0)) - 16
    assert np.isfinite(np.asarray(cloud.position)).all()


def test_without_a_capacity_nothing_is_dropped():
    points = courtyard(500, 0, noise=0.3)
    params = as_arrays(DownsampleParams(resolution=1e-3))
    cloud, dropped = downsample_jit(jnp.asarray(points), jnp.ones(500, bool), params=params)
    assert (int(dropped), int(cloud.valid.sum())) == (0, voxels(points, 1e-3)) == (0, 500)


@pytest.mark.parametrize("alike", [False, True])  # whatever the hash does, even if it is the same for all
def test_points_share_a_representative_if_and_only_if_they_share_a_cell(alike, monkeypatch):
    if alike:
        monkeypatch.setattr(cells, "PRIMES", (0, 0, 0))
    cell = np.random.default_rng(0).integers(-3, 3, (3, 600)).astype(np.int32)
    valid = np.arange(600) < 590
    first = np.asarray(jax.jit(lambda *x: cells.representatives(*x))(cell, valid))
    assert np.all(first[590:] == 600)
    assert np.all(first[first[:590]] == first[:590])
    assert np.array_equal(cell[:, first[:590]], cell[:, :590])
    assert len(set(first[:590])) == len(np.unique(cell[:, :590], axis=1).T)


@pytest.mark.parametrize("n", [1, 31, 32, 33, 1000, 5000])
def test_places_are_counted(n):
    mask = np.random.default_rng(n).uniform(size=n) < 0.4
    np.testing.assert_array_equal(jax.jit(cells.before)(mask), np.cumsum(mask) - mask)
    index = np.flatnonzero(mask)[:50]
    np.testing.assert_array_equal(
        jax.jit(cells.chosen, static_argnums=1)(mask, 50), np.pad(index, (0, 50 - len(index)), constant_values=n)
    )


def test_normals_are_those_of_the_ten_nearest_points():
    points = courtyard(1000, 3)
    valid = np.arange(1000) < 990
    cloud, certain = jax.jit(features)(
        registration.cloud(jnp.asarray(points), valid=jnp.asarray(valid)), as_arrays(FeatureParams(visits=256))
    )
    assert float(certain) == 1
    found, normals = np.asarray(cloud.position).T, np.asarray(cloud.normal).T
    good = 0
    for position, normal in zip(found[np.asarray(cloud.valid)], normals[np.asarray(cloud.valid)], strict=True):
        near = np.argsort(np.sum((points[:990] - position) ** 2, axis=1))[:10]
        expected = np.linalg.eigh(np.cov(points[near].T))[1][:, 0]
        good += abs(expected @ normal) > np.cos(np.radians(2.0))
        assert normal @ position <= 1e-6
    assert good >= 0.99 * 990
    shape = np.asarray(cloud.covariance)[:, 0]
    full = shape[[0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(3, 3)
    np.testing.assert_allclose(np.linalg.eigvalsh(full), [1e-3, 1, 1], atol=1e-5)


def test_a_pole_is_an_edge_and_a_line_on_the_ground_is_none():
    """A pole beside a patch of ground, and a ring of returns far off: only the pole is thin across two directions."""
    rng = np.random.default_rng(0)
    pole = np.stack([0.02 * rng.normal(size=100), 0.02 * rng.normal(size=100), np.linspace(0.5, 6, 100)], 1)
    ring = np.stack([40 + 0 * rng.normal(size=100), np.linspace(-9, 9, 100), 0.01 * rng.normal(size=100)], 1)
    points = np.concatenate([pole, ring])
    params = as_arrays(FeatureParams(edges=True))
    cloud, _ = jax.jit(features)(registration.cloud(jnp.asarray(points, jnp.float32)), params)
    full = np.asarray(cloud.covariance)[[0, 1, 2, 1, 3, 4, 2, 4, 5]].T.reshape(-1, 3, 3)
    values, vectors = np.linalg.eigh(full)
    upright = np.asarray(cloud.position)[0] < 1
    np.testing.assert_allclose(values[upright].mean(0), [1e-3, 1e-3, 1.0], atol=0.02)
    assert np.abs(vectors[upright, 2, 2]).mean() > 0.95
    np.testing.assert_allclose(values[~upright], np.tile([1e-3, 1.0, 1.0], (100, 1)), atol=1e-4)
    assert not np.asarray(cloud.normal)[:, upright].any(0).mean() > 0.1


def test_too_few_points_have_no_surface():
    cloud, _ = jax.jit(features)(registration.cloud(jnp.asarray(courtyard(1000, 0)), valid=jnp.arange(1000) < 4), None)
    assert not np.asarray(cloud.normal).any()
    assert int(cloud.valid.sum()) == 4


def test_padding_takes_the_origin_off_in_double_precision():
    points = courtyard(100, 0) + np.array([4e6, -3e6, 0.0])
    position, valid = registration.padded(points, 128, origin=(4e6, -3e6, 0.0))
    assert position.shape == (128, 3)
    assert valid.sum() == 100
    np.testing.assert_allclose(position[:100], courtyard(100, 0), atol=1e-6)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((0, 3)), r"shape \(0, 3\)"),
        (np.zeros((5, 2)), r"shape \(5, 2\)"),
        (np.zeros((9, 3)), "9 points do not fit the capacity 8"),
        (np.full((2, 3), np.nan), "2 points are not finite"),
    ],
)
def test_a_bad_cloud_is_named(points, message):
    with pytest.raises(CloudError, match=message):
        registration.padded(points, 8)
