"""The stated world: a furnished district, a point-cloud map of it from a drive of its own, and a drive to localize."""

import functools
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.course import Course, course_between
from urbanjax.io.clouds import pointmap
from urbanjax.localization import capacity, lidar, mapping
from urbanjax.localization.lidar import LidarLocalizerParams
from urbanjax.registration import MapParams, PointCloud, PreprocessParams
from urbanjax.registration.downsample import DownsampleParams, downsample
from urbanjax.roadmap.builders import district
from urbanjax.sim.lidar import LidarParams, sweep
from urbanjax.sim.scenarios import tour
from urbanjax.sim.scenarios.tour import Tour, TourParams
from urbanjax.sim.scenery.scenery import Scenery, furnish
from urbanjax.types import (
    POSITIVE,
    SEED,
    ConfigError,
    Observation,
    Odometry,
    Scan,
    Unread,
    as_arrays,
    field,
    host_record,
    pytree,
    static,
)

FIRST = 1  # the link on which the drives begin
LEAST = 10  # scans of a drive
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


@host_record
class World:
    """What the localizer is given, and the truth that it does not know."""

    course: Course  # with the map
    surroundings: Scenery
    points: mapping.PointMap
    tour: Tour


@pytree
class WorldParams:
    """The district and both drives."""

    drive: TourParams = TourParams()
    sensor: LidarParams = LidarParams()
    mapping: MappingParams = MappingParams()
    # m of the course that are mapped and driven, 0 for all of it
    stretch: float = field(default=0.0, metadata={"range": (0.0, 1e5)})
    seed: int = static(default=0, metadata=SEED)


def build(
    params: WorldParams, localizer: LidarLocalizerParams, tick: Callable[[str], None], file: str | Path = ""
) -> World:
    """The world of a seed. Args: file, a map made before; without one the district is mapped, a minute on two cores."""
    graph = district()
    last = int(graph.predecessor[FIRST, 0])
    course = course_between(graph, FIRST, goal=last)
    surroundings = jax.tree.map(jnp.asarray, furnish(graph, params.seed))
    key = jax.random.key(params.seed)
    if file:
        points = pointmap.load(file)
    else:
        tick("mapping the district")
        length = params.stretch + params.mapping.reach if params.stretch else math.inf
        first = jax.random.fold_in(key, 1)
        scans = survey(first, params.mapping, params.sensor, localizer, course, surroundings, float(length))
        points = mapping.build(((cloud, pose) for cloud, _, pose in scans), float(params.mapping.resolution))
    world = mapping.distributions(points, params.mapping.distributions)
    truth = tour.drive(jax.random.fold_in(key, 2), course.corridor, params=params.drive)
    if params.stretch:
        steps = int(np.searchsorted(np.asarray(truth.station), float(params.stretch)))
        if steps < LEAST:
            raise ConfigError(f"'world.stretch' of {float(params.stretch):g} m holds {steps} scans; {LEAST} are needed")
        truth = jax.tree.map(lambda x: x[:steps], truth)
    return World(course.replace(map=world), surroundings, points, truth)


def survey(
    key: jax.Array,
    how: MappingParams,
    sensor: LidarParams,
    localizer: LidarLocalizerParams,
    course: Course,
    surroundings: Scenery,
    length: float = math.inf,
    fine: DownsampleParams | None = None,
) -> Iterator[tuple[PointCloud, np.ndarray, np.ndarray]]:
    """Of each scan of the mapping drive: its cloud, points [N, 3] thinned as `fine` says, and the pose to map it at.

    Args: length [m], of the course that is surveyed.
    """
    drive = tour.drive(key, course.corridor, params=how.drive)
    station = np.asarray(drive.station)
    every = np.unique(np.searchsorted(station, np.arange(0, min(length, float(station[-1])), float(how.spacing))))
    rng = np.random.default_rng(np.asarray(jax.random.key_data(key)))
    fine = DownsampleParams(capacity=8) if fine is None else fine
    clear = mounted(localizer, sensor, how.drive.period).replace(preprocess=how.preprocess, sensing_radius=how.reach)
    clear = capacity.fitted(clear, scans=some_scans(clear, sensor, surroundings, drive, alone=True))
    args = as_arrays((sensor, clear, fine))

    @jax.jit
    def look(k: jax.Array, sensor: LidarParams, clear: LidarLocalizerParams, fine: DownsampleParams) -> tuple:
        ego, yaw_rate = jax.tree.map(lambda x: x[k], (drive.ego, drive.yaw_rate))
        scan = sweep(sensor, surroundings, vehicles=None, ego=ego, yaw_rate=yaw_rate, key=jax.random.fold_in(key, k))
        seen = observation(scan, Odometry(ego.speed, ego.acceleration, ego.steering, yaw_rate))
        thinned, _ = downsample(*lidar.points_of(clear, seen), params=fine)
        return lidar.cloud_of(clear, seen)[0], thinned.position.T, thinned.valid

    for k in every:
        x, y = np.asarray(drive.ego.position[k], float) + float(how.position_noise) * rng.normal(size=2)
        heading = float(drive.ego.heading[k]) + float(how.heading_noise) * rng.normal()
        cloud, points, valid = jax.device_get(look(jnp.asarray(k), *args))
        yield cloud, points[valid], mapping.matrix(x, y, heading=heading)


def observation(scan: Scan, odometry: Odometry) -> Observation:
    """What a localizer looks at, without the rest."""
    nothing: dict = {"objects": None, "signals": None}
    return Observation(odometry=odometry, scan=scan, **nothing)


def some_scans(
    localizer: LidarLocalizerParams, sensor: LidarParams, surroundings: Scenery, way: Tour, *, alone: bool = False
) -> list[np.ndarray]:
    """The points [N, 3] m that are looked at in some scans along a tour. Args: alone, without the moving vehicles."""
    args = as_arrays((localizer, sensor))
    found = []
    for k in np.unique(np.linspace(0, len(way.time) - 1, LOOKED_AT).astype(int)):
        points, valid = jax.device_get(_points(*args, surroundings, way, jnp.asarray(k), alone=alone))
        found.append(points[valid])
    return found


@functools.partial(jax.jit, static_argnames="alone")
def _points(
    localizer: LidarLocalizerParams, sensor: LidarParams, surroundings: Scenery, way: Tour, k: jax.Array, alone: bool
) -> tuple[jax.Array, jax.Array]:
    ego, yaw_rate, odometry, vehicles = jax.tree.map(
        lambda x: x[k], (way.ego, way.yaw_rate, way.odometry, None if alone else way.vehicles)
    )
    scan = sweep(sensor, surroundings, vehicles=vehicles, ego=ego, yaw_rate=yaw_rate, key=jax.random.key(0))
    return lidar.points_of(localizer, observation(scan, odometry))


def mounted(
    localizer: LidarLocalizerParams, sensor: LidarParams, period: float | jax.Array | None
) -> LidarLocalizerParams:
    """The localizer for a sensor, knowing where on the vehicle that is and how often it is asked (s)."""
    return localizer.replace(mount=sensor.mount, period=period)
