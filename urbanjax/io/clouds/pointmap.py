"""Point-cloud maps on disk: one npz file of plain arrays, with a JSON header."""

import os
from pathlib import Path

import numpy as np

from urbanjax.io import archive
from urbanjax.localization.mapping import PointMap
from urbanjax.types import FileError

FORMAT, VERSION = "urbanjax point-cloud map", 1
MAX_COORDINATE = 1e5  # m from the origin
RESOLUTIONS = (1e-3, 1e2)  # m
ROUNDING = 1e-5  # by which a minor of a covariance in float32 may be negative


def save(path: str | os.PathLike[str], points: PointMap) -> None:
    """Writes the map as npz, whole or not at all.

    Args: path of the file; points, the map. Raises FileError where the file cannot be written.
    """
    header = {
        "format": FORMAT,
        "version": VERSION,
        "points": len(points.position),
        "origin": list(points.origin),
        "resolution": points.resolution,
    }
    arrays = {
        "position": points.position.astype(np.float32),
        "covariance": points.covariance.astype(np.float32),
        "count": points.count.astype(np.int32),
    }
    archive.save(path, header, arrays=arrays)


def load(path: str | os.PathLike[str]) -> PointMap:
    """The map in the npz file.

    Args: path of the file. Raises FileError, naming file and key, for anything that is no map.
    """
    path = Path(path)
    header, arrays = archive.load(path, FORMAT, version=VERSION, names=("position", "covariance", "count"))
    n, origin, resolution = (header.get(key) for key in ("points", "origin", "resolution"))
    if not isinstance(n, int) or isinstance(n, bool) or n < 1:
        raise FileError(f"{path}: 'header' has no number of points")
    if not isinstance(origin, list) or len(origin) != 3 or not all(archive.is_finite(x) for x in origin):
        raise FileError(f"{path}: 'header' has no origin of three finite numbers")
    if not isinstance(resolution, int | float) or not RESOLUTIONS[0] <= resolution <= RESOLUTIONS[1]:
        raise FileError(f"{path}: 'header' has no resolution between 1 mm and 100 m")
    archive.expect(path, "position", array=arrays["position"], kind="f", shape=(n, 3))
    archive.expect(path, "covariance", array=arrays["covariance"], kind="f", shape=(n, 6))
    archive.expect(path, "count", array=arrays["count"], kind="i", shape=(n,))
    if np.abs(arrays["position"]).max() > MAX_COORDINATE:
        raise FileError(f"{path}: 'position' is farther than {MAX_COORDINATE:g} m from the origin")
    if arrays["count"].min() < 1:
        raise FileError(f"{path}: 'count' is not positive")
    xx, xy, xz, yy, yz, zz = arrays["covariance"].T.astype(float)
    minors = xx, yy, zz, xx * yy - xy * xy, xx * zz - xz * xz, yy * zz - yz * yz
    if min(minor.min() for minor in minors) < -ROUNDING:
        raise FileError(f"{path}: 'covariance' holds matrices that are no covariances")
    return PointMap(
        position=arrays["position"].astype(np.float32),
        covariance=arrays["covariance"].astype(np.float32),
        count=arrays["count"].astype(np.int32),
        origin=(float(origin[0]), float(origin[1]), float(origin[2])),
        resolution=float(resolution),
    )
