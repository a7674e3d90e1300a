"""Two scans in, a pose out: sizes, window and origin are chosen from the points, on the host."""

import warnings
from typing import Any

import jax
import jax.numpy as jnp
import jaxlie
import numpy as np
from scipy.spatial.transform import Rotation

from urbanjax.registration.align import Alignment, AlignParams, align
from urbanjax.registration.covariance import CovarianceParams
from urbanjax.registration.distributions import METHODS, MapParams, build
from urbanjax.registration.downsample import DownsampleParams, voxels
from urbanjax.registration.linear import FactorParams
from urbanjax.registration.points import checked, padded
from urbanjax.registration.preprocess import PreprocessParams, preprocess
from urbanjax.types import CloudError, ConfigError, Status, as_arrays, pytree
from urbanjax.types.arguments import array, kind, number, short, whole

THINNING = 4  # points along the edge of a voxel of the map
SIZES = 4  # sizes in an octave: similar clouds share one compiled program
LEAST = 64  # points, the smallest size, and what a registration needs
EDGE = 16  # voxels, of which a window's edge is a multiple
MOST = 2**24  # points of a scan that places are kept for
LARGEST = 2**26  # voxels of a window
FARTHEST = 1e7  # m from the origin of a scan
# Two single scans are no survey: sweeps are bent by motion, and voxels cut surfaces differently. On a real pair the
# methods of small_gicp, and two published poses, differ by 0.02 m and 0.2 to 0.4 degrees.
PAIR = CovarianceParams(floor_rotation=3e-3, floor_translation=0.015)
TOLERANCE = 1e-3  # of a start's rotation from an orthogonal one


class DroppedPointsWarning(UserWarning):
    """Points found no place in a capacity that the caller fixed."""


@pytree
class Registration:
    """The pose of one scan in the frame of another, and how sure it is."""

    T_target_source: np.ndarray  # [4, 4] float64
    covariance: np.ndarray  # [6, 6] float64, of the twist [omega (rad); v (m)] in the source's frame
    converged: bool  # never without a correspondence
    inlier_share: float  # of the thinned source's points, those with a correspondence
    dropped: int  # voxels of both scans for which the capacity had no place
    alignment: Alignment  # everything else that spoke for the pose, from the middles of both scans

    @property
    def status(self) -> Status:
        """OK, NOT_CONVERGED or NO_PAIRS, with a message."""
        return Status(int(self.alignment.status))

    def mahalanobis(self, T_target_source: Any) -> float:
        """Distance from another pose in standard deviations; 95 % of true poses lie within 3.55 (6 degrees of freedom).

        Args: T_target_source [4, 4], the other pose.
        """
        other = _pose(T_target_source, "T_target_source")
        away = np.linalg.inv(self.T_target_source) @ other
        rotation = Rotation.from_matrix(away[:3, :3]).as_rotvec()
        # First order in the rotation, as the covariance is.
        twist = np.concatenate([rotation, away[:3, 3] - np.cross(rotation, away[:3, 3]) / 2])
        return float(np.sqrt(twist @ np.linalg.solve(self.covariance, twist)))


def register(
    source: Any,
    target: Any,
    *,
    resolution: float = 1.0,
    start: Any = None,
    method: str = "vgicp",
    capacity: int | None = None,
    params: AlignParams | None = None,
) -> Registration:
    """The pose of `source` in the frame of `target` (Eq. 1-5), from a start within about a voxel of it.

    Both are thinned to a quarter of the resolution, the target becomes a map of distributions. Failure is a value: look
    at `status`, `inlier_share` and the covariance, which is calibrated for vgicp, with a floor of 15 mm and 3 mrad for
    what no calibration of single scans can know (`params.covariance`). For many scans on one map, compile `preprocess`,
    `build` and `align` yourself.
    Args: source [N, 3] m and target [M, 3] m, each in its own frame; resolution [m], edge of a voxel of the map; start
    [4, 4], T_target_source to begin from (default: the identity); method, one of vgicp, ndt and gicp; capacity, points
    kept of each scan (default: as many as there are; warns with DroppedPointsWarning if too few); params, of the
    alignment (default: pairs at most a voxel apart). Raises CloudError for points that are not [N, 3], finite and many
    enough, and ConfigError for a start that is no pose, and a method, resolution or capacity that there is not.
    """
    if method not in METHODS:
        raise ConfigError(f"method is {short(method)}: use one of {', '.join(METHODS)}")
    if capacity is not None:
        capacity = whole(capacity, "capacity", error=ConfigError, least=LEAST, most=MOST)
    if params is not None:
        kind(params, "params", wanted=AlignParams, error=ConfigError)
    resolution = number(resolution, "resolution", error=ConfigError)
    fine = resolution / THINNING
    scans = [checked(points, name) for name, points in (("source", source), ("target", target))]
    for name, points in zip(("source", "target"), scans, strict=True):
        if len(points) < LEAST or np.abs(points).max() > FARTHEST:
            raise CloudError(
                f"{name} has {len(points)} points up to {np.abs(points).max():.3g} m from its origin: at least {LEAST} "
                f"within {FARTHEST:g} m are needed"
            )
    # Middles are taken off in double precision: coordinates of many kilometres have no millimetres in float32.
    middles = [np.round((points.min(0) + points.max(0)) / 2) for points in scans]
    half = np.ptp(scans[0], axis=0) / 2
    scans = [points - middle for points, middle in zip(scans, middles, strict=True)]
    occupied = [voxels(points, fine) for points in scans]
    for name, count in zip(("source", "target"), occupied, strict=True):
        if count < LEAST:
            thinned = f"{name} has {count} points when thinned to {fine:g} m"
            raise CloudError(f"{thinned}, and {LEAST} are needed: lower resolution")
    kept = [size(count) if capacity is None else capacity for count in occupied]
    how_to_align = (
        AlignParams(factor=FactorParams(max_distance=resolution), covariance=PAIR) if params is None else params
    )
    begin = np.eye(4) if start is None else _pose(start, "start")
    T_middles = _shift(-middles[1]) @ begin @ _shift(middles[0])
    how = MapParams(resolution=resolution, method=method, shape=_window(scans[1], resolution))
    clouds = [padded(points, size(len(points))) for points in scans]
    thinned = [PreprocessParams(downsample=DownsampleParams(resolution=fine, capacity=count)) for count in kept]
    found = _program(
        *clouds, as_arrays(tuple(thinned)), as_arrays(how), _se3(T_middles), as_arrays(_without_floor(how_to_align))
    )
    dropped = sum(max(count - place, 0) for count, place in zip(occupied, kept, strict=True))
    if dropped:
        message = (
            f"{dropped} of {sum(occupied)} voxels found no place in capacity={capacity}: raise it, or leave it out"
        )
        warnings.warn(message, DroppedPointsWarning, stacklevel=2)
    pose = _shift(middles[1]) @ np.asarray(found.pose.as_matrix(), float) @ _shift(-middles[0])
    return Registration(
        T_target_source=pose,
        covariance=_covariance(found, how_to_align, middles[0], inside=bool(np.all(np.abs(middles[0]) <= half))),
        converged=bool(found.converged),
        inlier_share=float(found.inlier_share),
        dropped=dropped,
        alignment=found,
    )


def size(count: int) -> int:
    """A capacity, of which there are few: a quarter of an octave apart. Args: count, points to hold."""
    step = 2 ** max((max(count, LEAST) - 1).bit_length() - 1 - SIZES // 2, 0)
    return -(-max(count, LEAST) // step) * step


@jax.jit
def _program(
    source: tuple, target: tuple, thinned: tuple, how: MapParams, start: jaxlie.SE3, params: AlignParams
) -> Alignment:
    scan, _ = preprocess(*source, params=thinned[0])
    points, _ = preprocess(*target, params=thinned[1])
    # The window is as large as the target, whose middle is 0.
    world = build(points, how, centre=jnp.zeros(3, points.position.dtype))
    return align(scan, world, start=start, params=params)


def _window(points: np.ndarray, resolution: float) -> tuple[int, int, int]:
    """Voxels along x, y and z of a window around 0 that holds all points [N, 3]."""
    half = np.floor(np.abs(points).max(0) / resolution).astype(int) + 1
    x, y, z = (int(-(-2 * n // EDGE) * EDGE) for n in half)
    if x * y * z > LARGEST:
        extent = " x ".join(f"{v:.0f}" for v in np.ptp(points, axis=0))
        raise CloudError(
            f"the target spans {extent} m, {x * y * z:.1e} voxels: crop it, or raise resolution={resolution}"
        )
    return x, y, z


def _pose(matrix: Any, name: str) -> np.ndarray:
    pose = array(matrix.as_matrix() if isinstance(matrix, jaxlie.SE3) else matrix, name, error=ConfigError)
    if pose.shape != (4, 4):
        raise ConfigError(f"{name} has the shape {pose.shape}: it must be a pose [4, 4]")
    if not np.isfinite(pose).all() or not np.allclose(pose[3], [0, 0, 0, 1]):
        raise ConfigError(f"{name} is no pose: it must be finite, and end in the row 0 0 0 1")
    rotation = pose[:3, :3]
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > TOLERANCE or np.linalg.det(rotation) < 0:
        raise ConfigError(f"{name}[:3, :3] is no rotation: its columns must be orthogonal, right-handed unit vectors")
    return pose


def _shift(by: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = by
    return pose


def _se3(pose: np.ndarray) -> jaxlie.SE3:
    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat()
    return jaxlie.SE3(jnp.asarray([w, x, y, z, *pose[:3, 3]], jnp.zeros(()).dtype))


def _without_floor(params: AlignParams) -> AlignParams:
    still = params.covariance.replace(floor_rotation=0.0, floor_translation=0.0)
    return params.replace(covariance=still)


def _covariance(found: Alignment, params: AlignParams, middle: np.ndarray, *, inside: bool) -> np.ndarray:
    """The covariance about the source's origin, of that about its middle [3] m.

    The floor is that of the sensor: at the origin, where that lies `inside` the scan, and else in its middle.
    """
    x, y, z = middle
    adjoint = np.eye(6)
    adjoint[3:, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    how = params.covariance
    floor = np.diag(np.repeat([float(how.floor_rotation), float(how.floor_translation)], 3) ** 2)
    stated = np.asarray(found.covariance, float)
    if inside:
        return adjoint @ stated @ adjoint.T + floor
    return adjoint @ (stated + floor) @ adjoint.T
