"""Scans along a drive through furnished surroundings, and the point-cloud map that they make."""

from collections.abc import Iterator
from typing import ClassVar

import jax
import numpy as np

from urbanjax.localization import capacity, lidar, mapping
from urbanjax.localization.lidar import LidarLocalizerParams
from urbanjax.registration import MapParams, PointCloud, PreprocessParams
from urbanjax.registration.downsample import DownsampleParams, downsample
from urbanjax.roadmap.corridor import Corridor
from urbanjax.sim.lidar import LidarParams, sweep
from urbanjax.sim.scenarios import tour
from urbanjax.sim.scenarios.tour import Tour, TourParams
from urbanjax.sim.scenery.scenery import Scenery
from urbanjax.types import (
    POSITIVE,
    Objects,
    Observation,
    Odometry,
    Scan,
    Unread,
    VehicleState,
    as_arrays,
    field,
    pytree,
)

LOOKED_AT = 16  # scans that capacities are chosen from


@pytree
class MappingParams:
    """The drive that makes the map: off the lane's centre, nobody around, small errors of its poses."""

    UNREAD: ClassVar[dict[str, Unread | None]] = {
        "drive.vehicles": Unread("nobody is around while the map is made"),
        "drive.traffic_*": Unread("nobody is around while the map is made"),
    }

    drive: TourParams = TourParams(speed=10.0, offset=0.7)
    preprocess: PreprocessParams = PreprocessParams(downsample=DownsampleParams(resolution=0.5))
    distributions: MapParams = MapParams()
    spacing: float = field(default=4.0, metadata=POSITIVE)  # m between two scans
    resolution: float = field(default=0.5, metadata=POSITIVE)  # m, of the point-cloud map
    position_noise: float = 0.01  # m, standard deviation of its poses
    heading_noise: float = 2e-4  # rad, likewise
    reach: float = 70.0  # m, of the points that are mapped


def survey(
    how: MappingParams,
    corridor: Corridor,
    *,
    surroundings: Scenery,
    sensor: LidarParams,
    localizer: LidarLocalizerParams,
    key: jax.Array,
    fine: DownsampleParams | None = None,
) -> Iterator[tuple[PointCloud, np.ndarray, np.ndarray]]:
    """Of each scan of the mapping drive: its cloud, points [N, 3] (m) of it, and the pose [4, 4] to map it at (host).

    Args: how, the drive and what is kept of a scan; corridor, along the route to drive; surroundings, what stands
    beside it; sensor, the LiDAR; localizer, whose window bounds what is looked at; key, of all noise; fine, how the
    points are thinned (default: none are asked for).
    """
    drive = tour.drive(key, corridor, params=how.drive)
    station = np.asarray(drive.station)
    every = np.unique(np.searchsorted(station, np.arange(0, float(station[-1]), float(how.spacing))))
    rng = np.random.default_rng(np.asarray(jax.random.key_data(key)))
    fine = DownsampleParams(capacity=8) if fine is None else fine
    clear = mounted(localizer, sensor, period=how.drive.period)
    clear = clear.replace(preprocess=how.preprocess, sensing_radius=how.reach)
    if clear.preprocess.downsample.capacity is None:
        looked = some_scans(clear, sensor, surroundings=surroundings, way=drive, alone=True)
        clear = capacity.fitted(clear, scans=looked)
    args = as_arrays((sensor, clear, fine))
    for k in every:
        x, y = np.asarray(drive.ego.position[k], float) + float(how.position_noise) * rng.normal(size=2)
        heading = float(drive.ego.heading[k]) + float(how.heading_noise) * rng.normal()
        ego, yaw_rate = jax.tree.map(lambda x, k=k: x[k], (drive.ego, drive.yaw_rate))
        noise = jax.random.fold_in(key, k)
        cloud, points, valid = jax.device_get(_look(*args, surroundings, ego, yaw_rate, noise))
        yield cloud, points[valid], mapping.matrix(x, y, heading=heading)


@jax.jit
def _look(
    sensor: LidarParams,
    clear: LidarLocalizerParams,
    fine: DownsampleParams,
    surroundings: Scenery,
    ego: VehicleState,
    yaw_rate: jax.Array,
    key: jax.Array,
) -> tuple[PointCloud, jax.Array, jax.Array]:
    scan = sweep(sensor, surroundings, vehicles=None, ego=ego, yaw_rate=yaw_rate, key=key)
    seen = observation(scan, Odometry(ego.speed, ego.acceleration, ego.steering, yaw_rate))
    thinned, _ = downsample(*lidar.points_of(clear, seen), params=fine)
    return lidar.cloud_of(clear, seen)[0], thinned.position.T, thinned.valid


def observation(scan: Scan, odometry: Odometry) -> Observation:
    """What a localizer looks at, without the rest. Args: scan, of the LiDAR; odometry, at its stamp."""
    nothing: dict = {"objects": None, "signals": None}
    return Observation(odometry=odometry, scan=scan, **nothing)


def some_scans(
    localizer: LidarLocalizerParams, sensor: LidarParams, *, surroundings: Scenery, way: Tour, alone: bool = False
) -> list[np.ndarray]:
    """The points [N, 3] m that are looked at in some scans along a tour (host side).

    Args: localizer, mounted; sensor, the LiDAR; surroundings, what stands there; way, the tour; alone, without the
    moving vehicles.
    """
    args = as_arrays((localizer, sensor))
    found = []
    for k in np.unique(np.linspace(0, len(way.time) - 1, LOOKED_AT).astype(int)):
        there = jax.tree.map(
            lambda x, k=k: x[k], (way.ego, way.yaw_rate, way.odometry, None if alone else way.vehicles)
        )
        points, valid = jax.device_get(_points(*args, surroundings, *there))
        found.append(points[valid])
    return found


@jax.jit
def _points(
    localizer: LidarLocalizerParams,
    sensor: LidarParams,
    surroundings: Scenery,
    ego: VehicleState,
    yaw_rate: jax.Array,
    odometry: Odometry,
    vehicles: Objects | None,
) -> tuple[jax.Array, jax.Array]:
    scan = sweep(sensor, surroundings, vehicles=vehicles, ego=ego, yaw_rate=yaw_rate, key=jax.random.key(0))
    return lidar.points_of(localizer, observation(scan, odometry))


def mounted(
    localizer: LidarLocalizerParams, sensor: LidarParams, *, period: float | jax.Array | None
) -> LidarLocalizerParams:
    """The localizer for a sensor, knowing where on the vehicle that is and how often it is asked.

    Args: localizer; sensor, with its mount; period [s] of its steps.
    """
    return localizer.replace(mount=sensor.mount, period=period)
