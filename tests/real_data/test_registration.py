"""Registration of real scans against their published poses, from files to poses."""

import jax
import jaxlie
import numpy as np
import pytest

from urbanjax import registration
from urbanjax.io.clouds import pointclouds
from urbanjax.io.clouds.poses import read_kitti, read_matrix
from urbanjax.registration import AlignParams, MapParams, PreprocessParams
from urbanjax.registration.downsample import DownsampleParams
from urbanjax.registration.points import PointCloud
from urbanjax.types import as_arrays

pytestmark = pytest.mark.real_data
CAPACITY = 131072
preprocess_jit, build_jit, align_jit = (
    jax.jit(f) for f in (registration.preprocess, registration.build, registration.align)
)


def prepared(points: np.ndarray, resolution: float) -> PointCloud:
    params = PreprocessParams(downsample=DownsampleParams(resolution=resolution, capacity=16384))
    cloud, info = preprocess_jit(*registration.padded(points, CAPACITY), params=as_arrays(params))
    assert int(info.dropped) == 0
    return cloud


def error(found: jaxlie.SE3, truth: np.ndarray) -> tuple[float, float]:
    """Metres and degrees."""
    off = np.linalg.inv(truth) @ np.asarray(found.as_matrix(), float)
    turned = np.degrees(np.arccos(np.clip((np.trace(off[:3, :3]) - 1) / 2, -1, 1)))
    return float(np.linalg.norm(off[:3, 3])), float(turned)


def test_outdoor_pair(data_dir):
    folder = data_dir / "lidar" / "outdoor_pair"
    source, target = (prepared(pointclouds.read(folder / f"{name}.ply"), 0.25) for name in ("source", "target"))
    world = build_jit(target, as_arrays(MapParams()))
    found = align_jit(source, world, start=jaxlie.SE3.identity(), params=as_arrays(AlignParams()))
    metres, degrees = error(found.pose, read_matrix(folder / "T_target_source.txt"))
    assert bool(found.converged)
    assert float(found.inlier_share) > 0.8
    assert metres < 0.05
    assert degrees < 0.5


def test_every_step_of_kitti(data_dir):
    folder = data_dir / "lidar" / "kitti00"
    poses = read_kitti(folder / "ref_small_gicp_poses_velo.txt")
    maps, params = as_arrays((MapParams(), AlignParams()))
    before, step = None, jaxlie.SE3.identity()
    for k, pose in enumerate(poses):
        scan = prepared(pointclouds.read(folder / f"{k:06d}.bin"), 0.5)
        if before is not None:
            found = align_jit(scan, before, start=step, params=params)
            metres, degrees = error(found.pose, np.linalg.inv(poses[k - 1]) @ pose)
            assert bool(found.converged)
            assert metres < 0.03, (k, metres)
            assert degrees < 0.2, (k, degrees)
            step = found.pose
        before = build_jit(scan, maps)


def test_ouster_steps(data_dir):
    folder = data_dir / "lidar" / "ouster"
    poses = read_kitti(folder / "OS-1-128_v2.3.0_1024x10_lb_n3_poses_kitti.txt")
    file = folder / "OS-1-128_v2.3.0_1024x10_lb_n3_xyz.npz"
    scans = [prepared(pointclouds.read(file, f"scan{k}"), 0.5) for k in range(3)]
    for k in (1, 2):
        world = build_jit(scans[k - 1], as_arrays(MapParams()))
        found = align_jit(scans[k], world, start=jaxlie.SE3.identity(), params=as_arrays(AlignParams()))
        metres, _ = error(found.pose, np.linalg.inv(poses[k - 1]) @ poses[k])
        assert bool(found.converged)
        assert metres < 0.03, (k, metres)
