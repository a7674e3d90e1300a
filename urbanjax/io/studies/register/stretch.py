"""The stated world: a stretch of the furnished district through its intersection, mapped twice, and a drive on it."""

import dataclasses
from collections.abc import Callable, Iterator

import jax
import jax.numpy as jnp
import jaxlie
import numpy as np

from urbanjax.io.studies.localize.district import MappingParams, mounted, observation
from urbanjax.localization import lidar, mapping, motion
from urbanjax.localization.lidar import LidarLocalizerParams
from urbanjax.localization.mapping import PointMap
from urbanjax.registration import PointCloud
from urbanjax.registration.downsample import DownsampleParams, downsample
from urbanjax.roadmap.builders import district
from urbanjax.roadmap.course import Course, course_between
from urbanjax.sim.scenarios import tour
from urbanjax.sim.scenarios.tour import Tour, TourParams
from urbanjax.sim.sensors.lidar import LidarParams, sweep
from urbanjax.sim.sensors.surroundings import Surroundings, furnish
from urbanjax.types import Odometry, as_arrays, pytree, static

DRIVEN = (39, 50)  # first and last link of the drive: two before intersection C, where it turns left, and two after
MAPPED = (37, 53)  # one more on either side, as far as the sensor sees


@pytree
class StretchParams:
    """The drive that makes the maps, and the drive whose scans are registered."""

    drive: TourParams = TourParams()
    sensor: LidarParams = LidarParams()
    mapping: MappingParams = MappingParams()
    # NDT takes its covariances from the scatter of points: its map keeps more of them.
    fine: DownsampleParams = DownsampleParams(resolution=0.2, capacity=49152)
    fine_resolution: float = 0.1  # m, of its point-cloud map
    seed: int = static(default=0)


@dataclasses.dataclass(frozen=True)
class Stretch:
    """The world of a seed."""

    surroundings: Surroundings
    tour: Tour
    points: PointMap  # with covariances of surfaces, as the localizer's
    fine: PointMap  # points only


def build(params: StretchParams, localizer: LidarLocalizerParams, tick: Callable[[str, float | None], None]) -> Stretch:
    """Furnish, map and drive the stretch: half a minute on two idle cores."""
    tick("furnishing", None)
    graph = district()
    mapped, driven = (course_between(graph, *ends) for ends in (MAPPED, DRIVEN))
    surroundings = jax.tree.map(jnp.asarray, furnish(graph, params.seed))
    key = jax.random.key(params.seed)
    scans = list(_mapping_scans(jax.random.fold_in(key, 1), params, localizer, mapped, surroundings, tick))
    tick("merging", None)
    return Stretch(
        surroundings=surroundings,
        tour=tour.drive(jax.random.fold_in(key, 2), driven, params.drive),
        points=mapping.build(((cloud, pose) for cloud, _, pose in scans), float(params.mapping.resolution)),
        fine=mapping.build(((_bare(points), pose) for _, points, pose in scans), float(params.fine_resolution)),
    )


def _bare(points: np.ndarray) -> PointCloud:
    """Points [N, 3] without anything known of their surface."""
    n = len(points)
    none = np.zeros((6, n), np.float32)
    return PointCloud(position=points.T, covariance=none, normal=none[:3], valid=np.ones(n, bool))  # type: ignore[arg-type]


def _mapping_scans(
    key: jax.Array,
    params: StretchParams,
    localizer: LidarLocalizerParams,
    course: Course,
    surroundings: Surroundings,
    tick: Callable[[str, float | None], None],
) -> Iterator[tuple[PointCloud, np.ndarray, np.ndarray]]:
    """Of each scan: its cloud, finer points [N, 3], and the pose [4, 4] that the maps are made with."""
    drive = tour.drive(key, course, params.mapping.drive)
    station = np.asarray(drive.station)
    every = np.unique(np.searchsorted(station, np.arange(0, float(station[-1]), float(params.mapping.spacing))))
    rng = np.random.default_rng(params.seed)
    args = as_arrays((params.sensor, mounted(localizer, params.sensor), params.mapping, params.fine))

    @jax.jit
    def look(
        k: jax.Array, sensor: LidarParams, localizer: LidarLocalizerParams, how: MappingParams, fine: DownsampleParams
    ) -> tuple[PointCloud, jax.Array, jax.Array]:
        ego, yaw_rate = jax.tree.map(lambda x: x[k], (drive.ego, drive.yaw_rate))
        scan = sweep(sensor, surroundings, None, ego, yaw_rate, jax.random.fold_in(key, k))
        exact = Odometry(ego.speed, ego.acceleration, ego.steering, yaw_rate)
        clear = localizer.replace(preprocess=how.preprocess, sensing_radius=how.reach)
        cloud, _ = lidar.cloud_of(clear, observation(scan, exact))
        *place, yaw = localizer.mount
        mount = jaxlie.SE3.from_rotation_and_translation(jaxlie.SO3.from_z_radians(jnp.asarray(yaw)), jnp.stack(place))
        points = motion.deskew(scan, mount, exact)
        near = jnp.sum(points[:, :2] ** 2, axis=1) < how.reach**2
        thinned, _ = downsample(points, scan.valid.reshape(-1) & near, fine)
        return cloud, thinned.position.T, thinned.valid

    for n, k in enumerate(every):
        x, y = np.asarray(drive.ego.position, float)[k] + float(params.mapping.position_noise) * rng.normal(size=2)
        heading = float(drive.ego.heading[k]) + float(params.mapping.heading_noise) * rng.normal()
        cloud, points, valid = jax.device_get(look(jnp.asarray(k), *args))
        tick("mapping the stretch", n / len(every))
        yield cloud, points[valid], mapping.matrix(x, y, heading)
