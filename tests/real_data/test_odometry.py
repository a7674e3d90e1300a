"""Odometry on real scans, from a folder to poses, beside the published ones."""

import numpy as np
import pytest

from experiments.localize import folder
from experiments.localize.study import LocalizeStudy
from urbanjax.io.clouds.poses import read_kitti
from urbanjax.types import FileError

pytestmark = pytest.mark.real_data


def test_ten_scans_of_kitti(data_dir):
    files = folder.scans_in(data_dir / "lidar" / "kitti00")
    files = [file for file in files if file.suffix == ".bin"]
    truth = read_kitti(data_dir / "lidar" / "kitti00" / "ref_small_gicp_poses_velo.txt")
    study = LocalizeStudy()
    capacity = folder.capacity_for(study, files)
    poses, rows = folder.drive(study, files, capacity)
    away = np.linalg.norm((np.linalg.inv(np.linalg.inv(truth[0]) @ truth) @ poses)[:, :3, 3], axis=1)
    assert len(poses) == 10
    assert all(row["fits"] for row in rows)
    assert away.max() < 0.10
    most = max(row["points"] for row in rows)
    assert most <= capacity <= 1.6 * most
    assert folder.dropped([row["dropped voxels"] for row in rows], capacity) == ""


def test_scans_that_lose_voxels_are_counted_and_named(data_dir):
    files = folder.scans_in(data_dir / "lidar" / "kitti00")[:2]
    _, rows = folder.drive(LocalizeStudy(), files, 1024)
    lost = [row["dropped voxels"] for row in rows]
    assert [row["points"] for row in rows] == [1024, 1024]
    assert min(lost) > 1000
    said = folder.dropped(lost, 1024)
    assert said.startswith("2 of 2 scans have more voxels than localizer.preprocess.downsample.capacity=1024")
    assert str(max(lost)) in said


def test_a_folder_without_scans_is_refused(tmp_path):
    with pytest.raises(FileError, match="two are needed"):
        folder.scans_in(tmp_path)
    with pytest.raises(FileError, match="no such folder"):
        folder.scans_in(tmp_path / "none")
