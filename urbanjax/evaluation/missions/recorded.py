"""Recorded drives as missions: the ego in the place of each recorded driver, everybody else as recorded (host side)."""

import jax
import numpy as np

from urbanjax.evaluation.case import Case
from urbanjax.evaluation.missions.mission import LONGEST
from urbanjax.evaluation.recorded.scenes import RecordedScene
from urbanjax.evaluation.recorded.worlds import world_of
from urbanjax.roadmap.corridor import Corridor
from urbanjax.roadmap.progress import progress
from urbanjax.sim import lanes as tables
from urbanjax.sim.agents import TrafficParams
from urbanjax.sim.lanes import LaneTables
from urbanjax.types import ScenarioError, as_arrays, host_record
from urbanjax.vehicle.params import VehicleParams

ENOUGH = 0.8  # of the way that the recorded driver made
LEAST = 2.0  # m, that is asked for at least


@host_record
class RecordedMission:
    """The drives of one recording, with the vehicles that drove them.

    Success: 80 % of the way that the recorded driver made, within the time that it took (at most 30 s), without a
    violation; scores take that way for the expert's. Failure: a violation, or less. Others do not react: somebody who
    runs into the ego from behind is not its fault by the rule. Signals show what the map's programs say at the time of
    the record, and green where it has none; where a route enters and leaves the map its edge does not count.
    """

    scene: RecordedScene
    lanes: LaneTables  # of its map

    @property
    def name(self) -> str:
        """That of the scene."""
        return self.scene.name

    @property
    def size(self) -> str:
        """What the shapes of its cases depend on: drives of one scene share a program."""
        return self.scene.name

    @property
    def count(self) -> int:
        """Of its drives, which the seeds number."""
        return len(self.scene.starts)

    def case(self, seed: int, *, others: TrafficParams, vehicle: VehicleParams) -> Case:
        """One of its drives. Raises ScenarioError where there are not so many.

        Args: seed, its number; others, how traffic would drive; vehicle, that of the closed loop (not used: each drive
        has that of its recorded driver, or a default of its size).
        """
        if not 0 <= seed < self.count:
            raise ScenarioError(f"{self.name} has the drives 0 to {self.count - 1}, not {seed}")
        scene, start = self.scene, self.scene.starts[seed]
        if start.index is None:
            raise ScenarioError(f"{self.name}: nobody was recorded in the place of {start.name}")
        corridor, ego, replay, own = jax.tree.map(
            lambda x: np.asarray(x[seed]), (scene.corridor, scene.ego, scene.replay, scene.vehicle)
        )
        recording, last = scene.recording, start.first + start.steps - 1
        first, end = (
            float(_station(corridor, recording.position[k, start.index], float(recording.heading[k, start.index])))
            for k in (start.first, last)
        )
        now = start.first * recording.dt
        world = world_of(others, ego=ego, link=start.link, replay=replay, signals=scene.signals, time=now)
        asked = {
            "goal": first + max(ENOUGH * (end - first), LEAST),
            "limit": min((start.steps - 1) * recording.dt, LONGEST),
        }
        return Case(corridor, self.lanes, jax.device_get(world), **jax.device_get(as_arrays(asked)), vehicle=own)


def recorded_mission(scene: RecordedScene) -> RecordedMission:
    """The drives of a recording. Args: scene, of recorded drivers."""
    return RecordedMission(scene, jax.device_get(tables.from_graph(scene.graph)))


def _station(corridor: Corridor, position: np.ndarray, heading: float) -> float:
    place = _progress(*as_arrays((corridor, position, heading)))
    return float(np.minimum(place, corridor.length))


_progress = jax.jit(lambda corridor, position, heading: progress(corridor, position, heading=heading).station)
