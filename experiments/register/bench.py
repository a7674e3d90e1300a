"""Where scans are registered: every function compiled once for each set of shapes, with the clock on it."""

import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import jaxlie
import numpy as np
from jax import Array

from experiments.common import timing
from experiments.register.stretch import Stretch
from urbanjax.evaluation.survey import mounted, observation, some_scans
from urbanjax.localization import capacity, lidar, mapping, motion
from urbanjax.localization.lidar import PLANE, LidarLocalizerParams
from urbanjax.registration import Alignment, AlignParams, MapParams, PointCloud, align, voxelmap
from urbanjax.registration.distributions import DistributionMap
from urbanjax.registration.voxelmap import CutParams, VoxelMap
from urbanjax.sim.lidar import LidarParams, sweep
from urbanjax.sim.scenarios.tour import Tour
from urbanjax.sim.scenery.scenery import Scenery
from urbanjax.types import Odometry, Scan, VehicleState, as_arrays, host_record, pytree

BLOCK = 16384  # capacities of windows are multiples of it
ANYWHERE = 1e3  # m, a correspondence distance that never matters


@host_record
class Setting:
    """The parameters of Table I that we have too."""

    method: str
    channels: int  # the upper ones
    sensing: float  # m
    window: float  # m
    voxel: float  # m
    iterations: int
    epsilon: float  # m
    reach: float  # m, largest correspondence distance


@pytree
class Found:
    """One registration against the truth."""

    pose: jaxlie.SE3
    error: Array  # [3] longitudinal (m), lateral (m), heading (rad), of the pose in the true body frame
    twist: Array  # [3] of the truth from the pose, for its covariance
    covariance: Array  # [3, 3] of (x, y, heading)
    converged: Array
    iterations: Array
    inlier_share: Array
    matching_error: Array  # m (Eq. 1)


@pytree
class Seen:
    """What there is at one moment."""

    scan: Scan
    odometry: Odometry
    truth: jaxlie.SE3  # T_map_body


class BenchPrograms:
    """Compiled functions by name and shapes; calling one with shapes that are new compiles another."""

    def __init__(self) -> None:
        self.made: dict[Any, Any] = {}
        self.seconds = 0.0  # spent on compiling

    def __call__(self, function: Callable[..., Any], *arguments: Any, **static: Any) -> tuple[float, Any]:
        """Milliseconds of the call, warm, and its result."""
        leaves, tree = jax.tree.flatten(arguments)
        key = (function, tuple(static.items()), tree, tuple((x.shape, str(x.dtype)) for x in leaves))
        if key not in self.made:
            began = time.perf_counter()
            program = jax.jit(function, static_argnames=tuple(static)).lower(*arguments, **static).compile()
            self.seconds += time.perf_counter() - began
            jax.block_until_ready(program(*arguments))
            self.made[key] = program
        seconds, result = timing.timed(self.made[key], *arguments)
        return 1e3 * seconds, result

    def count(self) -> dict[str, int]:
        """BenchPrograms by the name of their function."""
        names = [key[0].__name__.strip("_") for key in self.made]
        return {name: names.count(name) for name in sorted(set(names))}


class Bench:
    """The stretch, its maps as distributions, and what is done with scans."""

    def __init__(
        self, stretch: Stretch, localizer: LidarLocalizerParams, sensor: LidarParams, neighbours: int, period: float
    ):
        """Args: period [s], between two scans."""
        self.stretch, self.programs = stretch, BenchPrograms()
        here = mounted(localizer, sensor, period=period)
        scans = some_scans(here, sensor, surroundings=stretch.surroundings, way=stretch.tour)
        self.localizer, self.sensor = as_arrays((capacity.fitted(here, scans=scans), sensor))
        self.neighbours, self.period = neighbours, float(period)
        self._maps: dict[tuple[str, float], VoxelMap] = {}
        self._sizes: dict[tuple[str, float, float], CutParams] = {}

    def look(self, k: int, key: Array, aside: tuple[float, float] = (0.0, 0.0)) -> Seen:
        """The scan at step k of the drive. Args: aside, moved to the left (m) and turned (rad)."""
        args = (self.sensor, self.stretch.surroundings, self.stretch.tour, jnp.asarray(k), key)
        return self.programs(_look, *args, jnp.asarray(aside, jnp.float32))[1]

    def cloud(self, seen: Seen, channels: int, sensing: float) -> tuple[float, PointCloud, int]:
        """Milliseconds, the cloud in the body frame, and how many voxels found no place in it."""
        localizer = self.localizer.replace(sensing_radius=jnp.asarray(sensing, jnp.float32))
        took, (cloud, dropped) = self.programs(_prepare, localizer, seen.scan, seen.odometry, channels=channels)
        return took, cloud, int(dropped)

    def window(self, setting: Setting, centre: Array) -> tuple[float, DistributionMap, int]:
        """Milliseconds, the map around a position, and how many of its voxels found no place."""
        world = self.map(setting.method, setting.voxel)
        radius = jnp.asarray(setting.window, jnp.float32)
        took, (window, missed) = self.programs(_cut, world, centre, radius, self._size(setting))
        return took, window, int(missed)

    def register(
        self, setting: Setting, cloud: PointCloud, window: DistributionMap, start: jaxlie.SE3, truth: jaxlie.SE3
    ) -> tuple[float, Found]:
        """Milliseconds and what was found, on this machine's side."""
        align = self.localizer.align
        params = align.replace(
            factor=align.factor.replace(max_distance=jnp.asarray(setting.reach, jnp.float32)),
            translation_tolerance=jnp.asarray(setting.epsilon, jnp.float32),
            neighbours=self.neighbours,
            max_iterations=setting.iterations,
        )
        return self.aligned(params, cloud, window, start, truth)

    def aligned(
        self, params: AlignParams, cloud: PointCloud, window: DistributionMap, start: jaxlie.SE3, truth: jaxlie.SE3
    ) -> tuple[float, Found]:
        """Likewise, with parameters of the alignment."""
        return self.programs(_register, params, cloud, window, start, truth)

    def map(self, method: str, voxel: float) -> VoxelMap:
        """The whole map of one kind."""
        if (method, voxel) not in self._maps:
            points = self.stretch.points if method == "vgicp" else self.stretch.fine
            self._maps[method, voxel] = mapping.distributions(points, MapParams(resolution=voxel, method=method))
        return self._maps[method, voxel]

    def _size(self, setting: Setting) -> CutParams:
        """A window that holds the radius everywhere on the drive: sizes cost time, so each radius has its own."""
        key = (setting.method, setting.voxel, setting.window)
        if key not in self._sizes:
            world = self.map(setting.method, setting.voxel)
            wide = 16 * (int(2 * setting.window / setting.voxel) // 16 + 1)
            high = 16 * (int(np.ptp(np.asarray(world.cell)[:, 2])) * 2 // 16 + 1)
            self._sizes[key] = CutParams(self._capacity(world, wide), (wide, wide, high))
        return self._sizes[key]

    def _capacity(self, world: VoxelMap, wide: int) -> int:
        """Voxels in the tiles that a window of `wide` voxels touches, the most along the drive."""
        cell = np.asarray(world.cell)[:, :2]
        place = np.asarray(self.stretch.tour.ego.position, float)[::5] / float(world.resolution)
        middle = place - np.asarray(world.first)[:2]
        reach = wide / 2 + world.tile
        most = max(int((np.abs(cell - here).max(1) <= reach).sum()) for here in middle)
        return BLOCK * (most // BLOCK + 1)


def _look(sensor: LidarParams, surroundings: Scenery, tour: Tour, k: Array, key: Array, aside: Array) -> Seen:
    parts = (tour.ego, tour.yaw_rate, tour.odometry, tour.vehicles)
    ego, yaw_rate, odometry, vehicles = jax.tree.map(lambda x: x[k], parts)
    left = jnp.stack([-jnp.sin(ego.heading), jnp.cos(ego.heading)])
    there: VehicleState = ego.replace(position=ego.position + aside[0] * left, heading=ego.heading + aside[1])
    scan = sweep(sensor, surroundings, vehicles=vehicles, ego=there, yaw_rate=yaw_rate, key=jax.random.fold_in(key, k))
    return Seen(scan, odometry, motion.spatial(there.pose))


def _prepare(
    localizer: LidarLocalizerParams, scan: Scan, odometry: Odometry, channels: int
) -> tuple[PointCloud, Array]:
    upper = jax.tree.map(lambda x: x[:channels], scan)
    return lidar.cloud_of(localizer, observation(upper, odometry))


def _cut(world: VoxelMap, centre: Array, radius: Array, params: CutParams) -> tuple[DistributionMap, Array]:
    return voxelmap.cut(world, centre, radius=radius, params=params)


def _register(
    params: AlignParams, cloud: PointCloud, window: DistributionMap, start: jaxlie.SE3, truth: jaxlie.SE3
) -> Found:
    found: Alignment = align(cloud, window, start=start, params=params)
    off = motion.planar(truth).inverse() @ motion.planar(found.pose)
    twist = (found.pose.inverse() @ truth).log()
    plane = jnp.array(PLANE)
    return Found(
        pose=found.pose.normalize(),
        error=jnp.concatenate([off.translation(), off.rotation().as_radians()[None]]),
        twist=jnp.stack([twist[0], twist[1], twist[5]]),
        covariance=found.covariance[jnp.ix_(plane, plane)],
        converged=found.converged,
        iterations=found.iterations,
        inlier_share=found.inlier_share,
        matching_error=found.matching_error,
    )
