"""Building the point-cloud map M^W from scans and their poses; on the host, before the drive."""

from collections.abc import Iterable
from dataclasses import dataclass

import jax
import numpy as np

from urbanjax.registration import MapParams, PointCloud
from urbanjax.registration.voxelmap import VoxelMap, voxelise
from urbanjax.types import CloudError

CHUNK = 2_000_000  # points that are merged at once


@dataclass(frozen=True)
class PointMap:
    """N points of a district, thinned to one per voxel of `resolution`."""

    position: np.ndarray  # [N, 3] float32, m from the origin
    covariance: np.ndarray  # [N, 6] float32, mean of the plane-regularised covariances: xx, xy, xz, yy, yz, zz
    count: np.ndarray  # [N] int32, points that each stands for
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m, map coordinates of this frame's (0, 0, 0)
    resolution: float = 0.25  # m


def build(
    scans: Iterable[tuple[PointCloud, np.ndarray]],
    resolution: float = 0.25,
    *,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> PointMap:
    """The map of scans: clouds in the body frame with features, each with its pose T_map_body [4, 4] (float64).

    Raises CloudError if there is no point. Args: scans, pairs of a cloud and a pose; resolution [m], of the voxels
    whose points are averaged; origin [m], taken off the poses in double precision.
    """
    merged: np.ndarray | None = None
    waiting: list[np.ndarray] = []
    for cloud, T_map_body in scans:
        waiting.append(_placed(cloud, np.asarray(T_map_body, float), np.asarray(origin)))
        if sum(map(len, waiting)) > CHUNK:
            merged, waiting = _merge([*([] if merged is None else [merged]), *waiting], resolution), []
    merged = _merge([*([] if merged is None else [merged]), *waiting], resolution) if waiting else merged
    if merged is None or not len(merged):
        raise CloudError("a map needs at least one scan with points: check the scans and their poses")
    return PointMap(
        position=merged[:, :3].astype(np.float32),
        covariance=merged[:, 3:9].astype(np.float32),
        count=np.round(merged[:, 9]).astype(np.int32),
        origin=origin,
        resolution=resolution,
    )


def distributions(points: PointMap, params: MapParams) -> VoxelMap:
    """The map as distributions, for the localizer (Eq. 3-5). Args: points, the thinned map."""
    return voxelise(points.position.astype(float), points.covariance.astype(float), count=points.count, params=params)


def _placed(cloud: PointCloud, T_map_body: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Rows [N, 10] of the cloud in the map: position from the origin (3), covariance (6), 1."""
    position, covariance, valid = (
        np.asarray(x, float) for x in jax.device_get((cloud.position, cloud.covariance, cloud.valid))
    )
    kept = valid > 0
    rotation, translation = T_map_body[:3, :3], T_map_body[:3, 3] - origin
    i, j = np.triu_indices(3)
    full = np.zeros((kept.sum(), 3, 3))
    full[:, i, j] = full[:, j, i] = covariance[:, kept].T
    rotated = (rotation @ full @ rotation.T)[:, i, j]
    return np.concatenate([position[:, kept].T @ rotation.T + translation, rotated, np.ones((len(rotated), 1))], 1)


def _merge(rows: list[np.ndarray], resolution: float) -> np.ndarray:
    """One row per voxel: means weighted by the number of points, and that number."""
    table = np.concatenate(rows)
    cell = np.floor(table[:, :3] / resolution).astype(np.int64)
    cell -= cell.min(0)
    extent = cell.max(0) + 1
    key = (cell[:, 0] * extent[1] + cell[:, 1]) * extent[2] + cell[:, 2]
    order = np.argsort(key, kind="stable")
    new = np.flatnonzero(np.diff(key[order], prepend=-1))
    weight = table[order, 9:]
    number = np.add.reduceat(weight, new)
    return np.concatenate([np.add.reduceat(weight * table[order, :9], new) / number, number], 1)


def matrix(x: float, y: float, *, heading: float) -> np.ndarray:
    """The pose T_map_body [4, 4] of a body upright on the ground. Args: x and y [m]; heading [rad]."""
    T_map_body = np.eye(4)
    T_map_body[:2, :2] = [[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]]
    T_map_body[:2, 3] = x, y
    return T_map_body
