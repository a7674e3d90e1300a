"""Maps: merged points, distributions as registration makes them, and files that survive or are refused."""

import json

import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax import registration
from urbanjax.io.clouds import pointmap
from urbanjax.localization import mapping
from urbanjax.localization.mapping import PointMap
from urbanjax.registration import MapParams
from urbanjax.registration.voxelmap import CutParams, cut, voxelise
from urbanjax.types import CloudError, FileError, as_arrays

CUT = CutParams(capacity=512, shape=(32, 32, 16))


def scattered(n: int = 400, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    position = rng.uniform([-8, -8, -2], [8, 8, 3], (n, 3))
    normal = rng.normal(size=(n, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    full = np.eye(3) - 0.999 * normal[:, :, None] * normal[:, None, :]
    i, j = np.triu_indices(3)
    return position, full[:, i, j]


@pytest.mark.parametrize("method", ["vgicp", "ndt"])
def test_a_window_is_what_registration_builds(method):
    position, covariance = scattered(4000)
    params = MapParams(resolution=1.0, shape=CUT.shape, method=method)
    world = voxelise(position, covariance, count=np.ones(len(position)), params=params, tile=4)
    centre = jnp.array([0.3, -0.2, 0.1])
    window, missed = cut(world, centre, radius=jnp.asarray(100.0), params=CutParams(capacity=2048, shape=CUT.shape))
    points = registration.PointCloud(
        jnp.asarray(position.T, jnp.float32),
        jnp.asarray(covariance.T, jnp.float32),
        jnp.zeros((3, len(position))),
        jnp.ones(len(position), bool),
    )
    built = registration.build(points, as_arrays(params), centre=centre)
    assert int(missed) == 0
    np.testing.assert_allclose(window.origin, built.origin)
    ours, theirs = window.rows[window.table], built.rows[built.table]
    there = theirs[:, 9] > 0
    np.testing.assert_array_equal(ours[:, 9] > 0, there)
    np.testing.assert_allclose(ours[there], theirs[there], atol=2e-4)


def test_a_window_that_is_too_small_says_so():
    position, covariance = scattered(4000)
    world = voxelise(position, covariance, count=np.ones(len(position)), params=MapParams(), tile=4)
    window, missed = cut(
        world, jnp.zeros(3), radius=jnp.asarray(100.0), params=CutParams(capacity=100, shape=CUT.shape)
    )
    assert int((window.rows[:, 9] > 0).sum()) == 100
    assert int(missed) == world.cell.shape[0] - 100


def test_outside_the_map_there_is_nothing():
    position, covariance = scattered()
    world = voxelise(position, covariance, count=np.ones(len(position)), params=MapParams(), tile=4)
    window, _ = cut(world, jnp.array([900.0, -900.0, 0.0]), radius=jnp.asarray(50.0), params=CUT)
    assert int((window.rows[:, 9] > 0).sum()) == 0


def test_scans_are_merged_by_voxel_in_double_precision():
    """Two scans of one point, seen from two poses 5 km from the map's origin."""
    at = np.array([[2.1, 0.3, 0.2]], np.float32)
    one = registration.cloud(jnp.asarray(at))
    two = registration.cloud(jnp.asarray(at - [[1.0, 0, 0]]))
    here, there = mapping.matrix(5000.0, 3000.0, heading=0.0), mapping.matrix(5001.0, 3000.0, heading=0.0)
    points = mapping.build([(one, here), (two, there)], 0.25, origin=(5000.0, 3000.0, 0.0))
    np.testing.assert_allclose(points.position, at, atol=1e-6)
    np.testing.assert_array_equal(points.count, [2])


def test_turned_scans_turn_their_covariances():
    flat = registration.PointCloud(
        jnp.array([[1.0], [0.0], [0.0]]),
        jnp.array([[1e-3], [0.0], [0.0], [1.0], [0.0], [1.0]]),
        jnp.zeros((3, 1)),
        jnp.ones(1, bool),
    )
    points = mapping.build([(flat, mapping.matrix(0.0, 0.0, heading=np.pi / 2))], 0.25)
    np.testing.assert_allclose(points.covariance[0], [1.0, 0, 0, 1e-3, 0, 1.0], atol=1e-6)
    np.testing.assert_allclose(points.position[0], [0.0, 1.0, 0.0], atol=1e-6)


def test_a_map_of_nothing_is_refused():
    with pytest.raises(CloudError, match="at least one scan"):
        mapping.build([])
    position, covariance = scattered(5)
    position[0, 0] = np.nan
    with pytest.raises(CloudError, match="finite"):
        voxelise(position, covariance, count=np.ones(5), params=MapParams())


@pytest.fixture
def stored(tmp_path):
    position, covariance = scattered(30)
    points = PointMap(
        position.astype(np.float32),
        covariance.astype(np.float32),
        np.arange(1, 31, dtype=np.int32),
        (1e5, 2.0, 0.0),
        0.5,
    )
    path = tmp_path / "map.npz"
    pointmap.save(path, points)
    with np.load(path) as file:
        return path, points, dict(file)


def test_a_map_survives_the_disk(stored):
    path, points, _ = stored
    loaded = pointmap.load(path)
    for name in ("position", "covariance", "count"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(points, name))
    assert (loaded.origin, loaded.resolution) == (points.origin, points.resolution)


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("position", lambda a: np.where(np.arange(3) == 0, np.nan, a)),
        ("position", lambda a: a * 1e6),
        ("position", lambda a: a[:-1]),
        ("covariance", lambda a: -a),
        ("covariance", lambda a: a.astype(np.int32)),
        ("count", lambda a: a * 0),
        ("count", lambda a: None),
    ],
)
def test_wrong_arrays_are_refused_by_key(stored, key, change):
    path, _, arrays = stored
    arrays[key] = change(arrays[key])
    np.savez(path, **{k: v for k, v in arrays.items() if v is not None})
    with pytest.raises(FileError, match=rf"map\.npz: .*'{key}'"):
        pointmap.load(path)


@pytest.mark.parametrize(
    "changes", [{"format": "urbanjax road graph"}, {"points": 0}, {"origin": [1]}, {"resolution": 0}, {"version": 2}]
)
def test_wrong_headers_are_refused(stored, changes):
    path, _, arrays = stored
    header = json.loads(arrays["header"].tobytes()) | changes
    np.savez(path, **(arrays | {"header": np.frombuffer(json.dumps(header).encode(), np.uint8)}))
    with pytest.raises(FileError, match="'header'"):
        pointmap.load(path)


def test_a_truncated_map_is_refused(stored):
    path, *_ = stored
    path.write_bytes(path.read_bytes()[:-400])
    with pytest.raises(FileError, match="npz"):
        pointmap.load(path)
