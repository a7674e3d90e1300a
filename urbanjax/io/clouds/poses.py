"""Trajectories as text files: KITTI (a 3x4 matrix per line) and TUM (time, translation, quaternion per line)."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from urbanjax.io.files import content
from urbanjax.types import FileError

TOLERANCE = 1e-3  # of a rotation matrix from an orthogonal one, and of a quaternion from unit length


def read_kitti(path: str | Path) -> np.ndarray:
    """Poses [T, 4, 4] of a KITTI file.

    Args: path of the file. Raises FileError, naming file and line, for anything that is no pose.
    """
    rows = _numbers(Path(path), 12)
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3] = rows.reshape(-1, 3, 4)
    _refuse(Path(path), _twisted(poses[:, :3, :3]), "the first three columns are no rotation")
    return poses


def read_tum(path: str | Path) -> tuple[np.ndarray, np.ndarray]:
    """Times [T] (s) and poses [T, 4, 4] of a TUM file: time x y z qx qy qz qw. Errors as of `read_kitti`.

    Args: path of the file.
    """
    rows = _numbers(Path(path), 8)
    size = np.linalg.norm(rows[:, 4:], axis=1)
    _refuse(Path(path), np.abs(size - 1) > TOLERANCE, "the quaternion has not the length 1")
    _refuse(Path(path), np.diff(rows[:, 0], prepend=-np.inf) <= 0, "the time does not increase")
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(rows[:, 4:]).as_matrix()
    poses[:, :3, 3] = rows[:, 1:4]
    return rows[:, 0], poses


def read_matrix(path: str | Path) -> np.ndarray:
    """One pose [4, 4], a row per line. Errors as of `read_kitti`.

    Args: path of the file.
    """
    rows = _numbers(Path(path), 4)
    if rows.shape != (4, 4) or np.abs(rows[3] - [0, 0, 0, 1]).max() > TOLERANCE:
        raise FileError(f"{path}: holds no matrix of four lines that ends in 0 0 0 1")
    _refuse(Path(path), _twisted(rows[None, :3, :3]), "the first three columns are no rotation")
    return rows


def write_kitti(path: str | Path, poses: np.ndarray) -> None:
    """Poses [T, 4, 4] as a KITTI file.

    Args: path of the file; poses [T, 4, 4].
    """
    np.savetxt(path, np.asarray(poses, float)[:, :3].reshape(-1, 12), fmt="%.9g")


def write_tum(path: str | Path, time: np.ndarray, *, poses: np.ndarray) -> None:
    """Times [T] (s) and poses [T, 4, 4] as a TUM file.

    Args: path of the file; time [T] s; poses [T, 4, 4].
    """
    poses = np.asarray(poses, float)
    quaternion = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
    rows = np.column_stack([np.asarray(time, float), poses[:, :3, 3], quaternion])
    np.savetxt(path, rows, fmt=["%.9f", *["%.9g"] * 7])


def _numbers(path: Path, columns: int) -> np.ndarray:
    """The rows of a text file of numbers; lines that are empty or begin with # do not count."""
    rows = []
    for number, line in enumerate(content(path).decode("utf-8", "replace").splitlines(), 1):
        words = line.replace(",", " ").split()
        if not words or words[0].startswith("#"):
            continue
        try:
            row = [float(word) for word in words]
        except ValueError as error:
            raise FileError(f"{path}, line {number}: {error}") from error
        if len(row) != columns or not np.isfinite(row).all():
            raise FileError(f"{path}, line {number}: {columns} finite numbers were expected, not '{line.strip()[:60]}'")
        rows.append(row)
    if not rows:
        raise FileError(f"{path}: holds no poses")
    return np.array(rows)


def _twisted(rotation: np.ndarray) -> np.ndarray:
    """Which matrices [T, 3, 3] are no rotations [T]."""
    off = np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)).max((1, 2))
    return (off > TOLERANCE) | (np.linalg.det(rotation) < 0)


def _refuse(path: Path, wrong: np.ndarray, what: str) -> None:
    if wrong.any():
        raise FileError(f"{path}, pose {int(np.argmax(wrong)) + 1}: {what}")
