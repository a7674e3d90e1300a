"""The stated world: a stretch of the furnished district through its intersection, mapped twice, and a drive on it."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.course import course_between
from urbanjax.evaluation.survey import MappingParams, survey
from urbanjax.localization import mapping
from urbanjax.localization.lidar import LidarLocalizerParams
from urbanjax.localization.mapping import PointMap
from urbanjax.registration import PointCloud
from urbanjax.registration.downsample import DownsampleParams
from urbanjax.roadmap.builders import district
from urbanjax.sim.lidar import LidarParams
from urbanjax.sim.scenarios import tour
from urbanjax.sim.scenarios.tour import Tour, TourParams
from urbanjax.sim.scenery.scenery import Scenery, furnish
from urbanjax.types import SEED, host_record, pytree, static

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
    seed: int = static(default=0, metadata=SEED)


@host_record
class Stretch:
    """The world of a seed."""

    surroundings: Scenery
    tour: Tour
    points: PointMap  # with covariances of surfaces, as the localizer's
    fine: PointMap  # points only


def build(params: StretchParams, localizer: LidarLocalizerParams, tick: Callable[[str, float | None], None]) -> Stretch:
    """Furnish, map and drive the stretch: half a minute on two idle cores."""
    tick("furnishing", None)
    graph = district()
    mapped, driven = (course_between(graph, first, goal=last) for first, last in (MAPPED, DRIVEN))
    surroundings = jax.tree.map(jnp.asarray, furnish(graph, params.seed))
    key = jax.random.key(params.seed)
    tick("mapping the stretch", None)
    first = jax.random.fold_in(key, 1)
    scans = list(
        survey(
            params.mapping,
            mapped.corridor,
            surroundings=surroundings,
            sensor=params.sensor,
            localizer=localizer,
            key=first,
            fine=params.fine,
        )
    )
    tick("merging", None)
    return Stretch(
        surroundings=surroundings,
        tour=tour.drive(jax.random.fold_in(key, 2), driven.corridor, params=params.drive),
        points=mapping.build(((cloud, pose) for cloud, _, pose in scans), float(params.mapping.resolution)),
        fine=mapping.build(((_bare(points), pose) for _, points, pose in scans), float(params.fine_resolution)),
    )


def _bare(points: np.ndarray) -> PointCloud:
    """Points [N, 3] without anything known of their surface."""
    n = len(points)
    none = np.zeros((6, n), np.float32)
    return PointCloud(position=points.T, covariance=none, normal=none[:3], valid=np.ones(n, bool))  # type: ignore[arg-type]
