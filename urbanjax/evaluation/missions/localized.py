"""Missions driven on poses from scans, with or without something that fails (host side)."""

import dataclasses
import threading
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.evaluation.case import Case
from urbanjax.evaluation.missions.mission import ROADS, Mission
from urbanjax.evaluation.survey import MappingParams, survey
from urbanjax.localization import mapping
from urbanjax.localization.lidar import LidarLocalizerParams
from urbanjax.registration import PreprocessParams
from urbanjax.registration.downsample import DownsampleParams
from urbanjax.registration.voxelmap import VoxelMap, padded, without
from urbanjax.sim.agents import TrafficParams
from urbanjax.sim.lidar import LidarParams
from urbanjax.sim.scenery.scenery import Scenery, furnish
from urbanjax.sim.sensing import Sensing, WheelErrors
from urbanjax.types import CloudError, ConfigError, as_arrays, host_record
from urbanjax.vehicle.params import VehicleParams

GIVEN = "given"  # beside LOCALIZATIONS: drivers are told where they are, as in the missions themselves
SILENT = (1.0, 5.0)  # s, that no scan arrives
BEGINS = (1.0, 6.0)  # s after the start, when that begins
GAP = 50.0  # m of the road without a map
AHEAD = (20.0, 80.0)  # m in front of the start, where its middle lies
MOVED = (8.0, 30.0)  # m along the road, by which the pose is wrong that is told
SURVEYED, DRIVEN = 1, 2  # purposes of noise
VOXELS, TILES = 98304, 48  # of the map of one road
CLEAR = PreprocessParams(downsample=DownsampleParams(resolution=0.5, capacity=16384))  # of scans that are mapped


def scans(case: Case, rng: np.random.Generator) -> Case:
    """Nothing fails: poses from scans on the map instead of given ones. Args: case; rng, not drawn from."""
    return case


def scan_loss(case: Case, rng: np.random.Generator) -> Case:
    """For 1 to 5 s, beginning 1 to 6 s after the start, no scan arrives. Args: case; rng."""
    begin = float(case.start.time) + rng.uniform(*BEGINS)
    return _sensing(case, silent=np.array([begin, begin + rng.uniform(*SILENT)]))


def map_gap(case: Case, rng: np.random.Generator) -> Case:
    """50 m of the road are not in the map, their middle 20 to 80 m in front of the start. Args: case; rng."""
    assert case.map is not None
    x, y, heading = _along(case, rng.uniform(*AHEAD))
    found = _without(case.map, np.array([x, y], np.float32), heading=np.float32(heading), length=np.float32(GAP))
    return dataclasses.replace(case, map=jax.device_get(found))


def kidnapping(case: Case, rng: np.random.Generator) -> Case:
    """The pose that is told at the start lies 8 to 30 m behind the true one or in front of it. Args: case; rng."""
    return _sensing(case, told=_along(case, rng.uniform(*MOVED) * rng.choice([-1.0, 1.0])))


LOCALIZATIONS: dict[str, Callable[[Case, np.random.Generator], Case]] = {
    "scans": scans,
    "scan_loss": scan_loss,
    "map_gap": map_gap,
    "kidnapping": kidnapping,
}


@host_record
class LocalizedMission:
    """A mission on whose roads something stands, which were mapped, and where the driver is told no pose but scans.

    Only the stack finds its pose from them. What counts is what counts in the mission; who is lost is to stop.
    """

    mission: Mission
    how: str  # one of LOCALIZATIONS
    roads: "Roads"

    @property
    def name(self) -> str:
        """That of the mission and of what fails."""
        return f"{self.mission.name}_{self.how}"

    @property
    def longest(self) -> float:
        """Duration [s] of its logs."""
        return self.mission.longest

    @property
    def size(self) -> tuple:
        """What the shapes of its cases depend on."""
        return self.mission.size, "mapped"

    def case(self, seed: int, *, others: TrafficParams, vehicle: VehicleParams) -> Case:
        """The drive of a seed: that of the mission, and what fails drawn for it.

        Args: seed; others, how traffic drives; vehicle, the ego's dimensions.
        """
        case = self.mission.case(seed, others=others, vehicle=vehicle)
        surroundings, known = self.roads.of(self.mission, seed % ROADS, case=case)
        fields: dict[str, Any] = {
            "key": np.asarray(jax.random.key_data(_key(DRIVEN, self.mission.number, seed))),
            "wheels": jax.device_get(as_arrays(WheelErrors())),
            "silent": np.full(2, -np.inf, np.float32),
            "told": np.array([*case.start.ego.position, case.start.ego.heading], np.float32),
        }
        sensing = Sensing(surroundings, **fields)
        rng = np.random.default_rng([self.mission.number, seed, 2, list(LOCALIZATIONS).index(self.how)])
        return LOCALIZATIONS[self.how](dataclasses.replace(case, map=known, sensing=sensing), rng)


class Roads:
    """What stands beside the roads of missions, and their maps: each is furnished and surveyed once."""

    def __init__(self, sensor: LidarParams) -> None:
        """None yet. Args: sensor, the LiDAR that they are mapped with."""
        self.sensor = as_arrays(sensor)
        self._found: dict[tuple[str, int], tuple[Scenery, VoxelMap]] = {}
        self._lock = threading.Lock()

    def of(self, mission: Mission, which: int, *, case: Case) -> tuple[Scenery, VoxelMap]:
        """Surroundings and map of a road, in shapes that all roads of a size share.

        Args: mission; which, of its roads; case, on it. Raises ConfigError where they do not fit into these.
        """
        with self._lock:
            if (mission.name, which) not in self._found:
                try:
                    self._found[mission.name, which] = mapped(case, self.sensor, mission=mission, which=which)
                except CloudError as error:
                    raise ConfigError(
                        f"road {which} of {mission.name} cannot be mapped: {error}; see 'sensor' (its rings, columns "
                        "and range), or ask 'localization=[given]' of this mission"
                    ) from error
            return self._found[mission.name, which]


def mapped(case: Case, sensor: LidarParams, *, mission: Mission, which: int) -> tuple[Scenery, VoxelMap]:
    """Furnish the road of a case and survey it along the route: a few seconds.

    Args: case; sensor, the LiDAR; mission; which, of its roads. Raises CloudError for more than there is room for.
    """
    surroundings = _room(furnish(case.lanes.graph, mission.number * ROADS + which), mission.size.n_prisms)
    how = as_arrays(MappingParams(preprocess=CLEAR))
    found = survey(
        how,
        jax.tree.map(jnp.asarray, case.corridor),
        surroundings=jax.tree.map(jnp.asarray, surroundings),
        sensor=sensor,
        localizer=as_arrays(LidarLocalizerParams()),
        key=_key(SURVEYED, mission.number, which),
    )
    points = mapping.build(((cloud, pose) for cloud, _, pose in found), float(how.resolution))
    known = padded(mapping.distributions(points, how.distributions), VOXELS, tiles=TILES)
    return jax.device_get((surroundings, known))


def _key(*numbers: int) -> jax.Array:
    """The key of the noise of one purpose. Args: numbers, that tell it from all others."""
    key = jax.random.key(numbers[0])
    for number in numbers[1:]:
        key = jax.random.fold_in(key, number)
    return key


def _room(surroundings: Scenery, prisms: int) -> Scenery:
    """The same with room for that many."""
    spare = prisms - len(surroundings.valid)
    if spare < 0:
        raise CloudError(f"{len(surroundings.valid)} prisms stand beside it, and there is room for {prisms}")
    return jax.tree.map(lambda x: np.pad(np.asarray(x), [(0, spare)] + [(0, 0)] * (x.ndim - 1)), surroundings)


def _sensing(case: Case, **changes: np.ndarray) -> Case:
    assert case.sensing is not None
    changed = {name: value.astype(np.float32) for name, value in changes.items()}
    return dataclasses.replace(case, sensing=dataclasses.replace(case.sensing, **changed))


def _along(case: Case, way: float) -> np.ndarray:
    """Pose [3] x, y (m), heading (rad) on the route, or beside it as the ego is, some way [m] from the start."""
    corridor, ego = case.corridor, case.start.ego
    position, heading = np.asarray(corridor.position, float), np.asarray(corridor.heading, float)
    known = np.flatnonzero(np.asarray(corridor.valid))
    here = known[np.argmin(np.linalg.norm(position[known] - np.asarray(ego.position), axis=1))]
    there = int(np.clip(here + round(way / float(corridor.spacing)), known[0], known[-1]))
    turned = np.array([[np.cos(a := heading[there] - heading[here]), -np.sin(a)], [np.sin(a), np.cos(a)]])
    x, y = position[there] + turned @ (np.asarray(ego.position, float) - position[here])
    return np.array([x, y, float(ego.heading) + heading[there] - heading[here]])


_without = jax.jit(without)
