"""Trajectories come back as they were written; what is wrong with a file is said in one line."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from urbanjax.io.clouds import poses
from urbanjax.types import FileError


@pytest.fixture
def track() -> np.ndarray:
    rng = np.random.default_rng(0)
    out = np.tile(np.eye(4), (12, 1, 1))
    out[:, :3, :3] = Rotation.random(12, random_state=0).as_matrix()
    out[:, :3, 3] = 1000 * rng.normal(size=(12, 3))
    return out


def test_kitti_gives_the_poses_back(track, tmp_path):
    poses.write_kitti(tmp_path / "poses.txt", track)
    np.testing.assert_allclose(poses.read_kitti(tmp_path / "poses.txt"), track, rtol=1e-8, atol=1e-8)


def test_tum_gives_times_and_poses_back(track, tmp_path):
    time = 1.6e9 + 0.1 * np.arange(12)
    poses.write_tum(tmp_path / "poses.tum", time, poses=track)
    found, back = poses.read_tum(tmp_path / "poses.tum")
    np.testing.assert_allclose(found, time, rtol=0, atol=1e-6)
    np.testing.assert_allclose(back, track, rtol=1e-8, atol=1e-7)


EYE = "1 0 0 0 0 1 0 0 0 0 1 0"
BAD = {
    "missing": (poses.read_kitti, None, "no such file"),
    "empty": (poses.read_kitti, "# nothing\n\n", "holds no poses"),
    "truncated": (poses.read_kitti, f"{EYE}\n1 0 0", "line 2: 12 finite numbers"),
    "no number": (poses.read_kitti, EYE.replace("1", "one", 1), "line 1: could not convert"),
    "not finite": (poses.read_kitti, EYE.replace("0", "nan", 1), "line 1: 12 finite numbers"),
    "no rotation": (poses.read_kitti, f"{EYE}\n{EYE.replace('1', '2', 1)}", "pose 2: .* no rotation"),
    "mirror": (poses.read_kitti, EYE.replace("1", "-1", 1), "no rotation"),
    "no unit quaternion": (poses.read_tum, "0 0 0 0 0 0 0 2", "pose 1: the quaternion"),
    "half a matrix": (poses.read_matrix, "1 0 0 0\n0 1 0 0", "no matrix of four lines"),
    "a matrix that is no pose": (poses.read_matrix, "2 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1", "no rotation"),
    "time stands still": (poses.read_tum, "0 0 0 0 0 0 0 1\n0 0 0 0 0 0 0 1", "pose 2: the time"),
}


@pytest.mark.parametrize(("reader", "text", "message"), BAD.values(), ids=BAD)
def test_a_bad_file_is_named_in_one_line(reader, text, message, tmp_path):
    path = tmp_path / "poses.txt"
    if text is not None:
        path.write_text(text)
    with pytest.raises(FileError, match=message) as caught:
        reader(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
