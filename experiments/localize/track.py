"""Driving a localizer along a drive, scan by scan, and what became of it."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import jaxlie
import numpy as np
from jax import Array

from experiments.common import timing
from experiments.common.district import World
from urbanjax.evaluation.survey import observation
from urbanjax.localization import lidar, motion, relocalize
from urbanjax.localization.lidar import LidarLocalizerParams, LidarState
from urbanjax.localization.relocalize import RelocalizeParams
from urbanjax.localization.types import Health
from urbanjax.registration.voxelmap import VoxelMap
from urbanjax.sim.lidar import LidarParams, sweep
from urbanjax.sim.scenery.scenery import Scenery
from urbanjax.types import Observation, VehicleState, host_record, pytree


@pytree
class TrackRow:
    """One scan: errors are (longitudinal m, lateral m, heading rad) in the true body frame."""

    pose: Array  # [3] x, y (m), heading (rad)
    error: Array  # [3] of the pose put out
    registered: Array  # [3] of the registration, believed or not
    odometry: Array  # [3] x, y, heading of odometry alone, from its start
    covariance: Array  # [3, 3]
    health: Array
    failed: Array
    signs: Array  # [8]
    literal: Array  # Eq. 8
    inlier_share: Array
    matching_error: Array  # m
    residual: Array  # mean squared Mahalanobis distance
    iterations: Array
    dropped: Array  # [2]


@host_record
class LocalizedTrack:
    """T scans, in order."""

    index: np.ndarray  # [T] of the step of the tour
    rows: Any  # a TrackRow of numpy arrays [T, ..]
    milliseconds: np.ndarray  # [T] of the localizer's step, the first one with its compilation
    relocalized: np.ndarray  # [T] bool, the pose was found anew after this scan
    relocalize_ms: np.ndarray  # [..] of each such search

    @property
    def distance(self) -> np.ndarray:
        """Planar error [T] m of the pose put out."""
        return np.hypot(self.rows.error[:, 0], self.rows.error[:, 1])

    @property
    def registered(self) -> np.ndarray:
        """Planar error [T] m of the registration."""
        return np.hypot(self.rows.registered[:, 0], self.rows.registered[:, 1])


class LocalizerPrograms:
    """The compiled functions of one localizer, shared by all of its drives."""

    def __init__(self, world: World, localizer: LidarLocalizerParams, search: RelocalizeParams, sensor: LidarParams):
        """Args: parameters as arrays (`types.as_arrays`)."""
        self.world, self.localizer, self.search, self.sensor = world, localizer, search, sensor
        self.graph = world.course.graph
        self._look = jax.jit(_look)
        self._step = jax.jit(_step)
        self._find = jax.jit(_find)
        self._init = jax.jit(lidar.init)

    def run(
        self,
        key: Array,
        index: Sequence[int],
        change: "Change | None" = None,
        stop_at: float | None = None,
        tick: Callable[[], None] = lambda: None,
    ) -> LocalizedTrack:
        """Localize along the steps `index` of the tour; the pose is known at the first one.

        Args: change, a fault; stop_at [m], an error at which there is no use in going on.
        """
        change = Change() if change is None else change
        tour, truth = self.world.tour, self.world.course.map if change.map is None else change.map
        state = self._init(self.localizer, _at(tour.ego, index[0]).pose)
        rows, took, anew, searches = [], [], [], []
        for n, k in enumerate(index):
            surroundings = self.world.surroundings if change.surroundings is None else change.surroundings
            seen = self._look(self.sensor, surroundings, tour, jnp.asarray(k), key, jnp.asarray(n in change.lost))
            seen = jax.block_until_ready(seen)
            seconds, (row, state) = timing.timed(self._step, self.localizer, truth, self.graph, state, *seen)
            took.append(1e3 * seconds)
            rows.append(row)
            found = False
            if int(row.health) in (Health.LANE, Health.RELOCALIZE):
                seconds, (answer, state) = timing.timed(
                    self._find, self.search, self.localizer, truth, self.graph, state, seen[0]
                )
                searches.append(1e3 * seconds)
                found = bool(answer.found)
            anew.append(found)
            tick()
            if stop_at is not None and float(np.hypot(*row.error[:2])) > stop_at:
                break
        stacked = jax.tree.map(lambda *x: np.stack([np.asarray(v) for v in x]), *rows)
        return LocalizedTrack(
            np.asarray(index[: len(rows)]), stacked, np.array(took), np.array(anew), np.array(searches)
        )


@host_record
class Change:
    """What is other than it should be on a drive."""

    lost: frozenset[int] = frozenset()  # places in the drive at which no scan arrives
    map: VoxelMap | None = None
    surroundings: Scenery | None = None  # what there is to see


def _at(tree: Any, k: Any) -> Any:
    return jax.tree.map(lambda x: x[k], tree)


def _look(
    sensor: LidarParams, surroundings: Scenery, tour: Any, k: Array, key: Array, lost: Array
) -> tuple[Observation, VehicleState]:
    """What is observed at step k, and the truth."""
    ego, yaw_rate, odometry, vehicles = _at((tour.ego, tour.yaw_rate, tour.odometry, tour.vehicles), k)
    scan = sweep(sensor, surroundings, vehicles=vehicles, ego=ego, yaw_rate=yaw_rate, key=jax.random.fold_in(key, k))
    scan = scan.replace(valid=scan.valid & ~lost)
    return observation(scan, odometry), ego


def _step(
    params: LidarLocalizerParams,
    world: VoxelMap,
    graph: Any,
    state: LidarState,
    seen: Observation,
    truth: VehicleState,
) -> tuple[TrackRow, LidarState]:
    located, following = lidar.step(params, world, graph, state, seen)
    info, back = located.info, truth.pose.inverse()
    alignment = info.alignment
    row = TrackRow(
        pose=_flat(located.pose),
        error=_flat(back @ located.pose),
        registered=_flat(back @ motion.planar(alignment.pose)),
        odometry=_flat(motion.planar(info.T_start_body)),
        covariance=located.covariance,
        health=located.health,
        failed=info.failed,
        signs=info.signs,
        literal=info.literal_gate,
        inlier_share=alignment.inlier_share,
        matching_error=alignment.matching_error,
        residual=2 * alignment.cost / jnp.maximum(alignment.inliers, 1),
        iterations=alignment.iterations,
        dropped=info.dropped,
    )
    return row, following


def _find(
    search: RelocalizeParams,
    params: LidarLocalizerParams,
    world: VoxelMap,
    graph: Any,
    state: LidarState,
    seen: Observation,
) -> tuple[relocalize.Relocalization, LidarState]:
    starts = relocalize.lane_starts(graph, state.T_map_body, count=search.starts)
    return relocalize.relocalize(search, params, world=world, state=state, observation=seen, starts=starts)


def _flat(pose: jaxlie.SE2) -> Array:
    return jnp.concatenate([pose.translation(), pose.rotation().as_radians()[None]])
