"""Recordings as missions: the ego in the place of a recorded driver or in a planning problem (host side)."""

import jax
import numpy as np

from urbanjax.evaluation.aim import Aim
from urbanjax.evaluation.case import Case
from urbanjax.evaluation.missions.mission import LONGEST
from urbanjax.evaluation.recorded.goals import aims, entry, station
from urbanjax.evaluation.recorded.scenes import RecordedScene
from urbanjax.evaluation.recorded.worlds import world_of
from urbanjax.sim import lanes as tables
from urbanjax.sim.agents import TrafficParams
from urbanjax.sim.lanes import LaneTables
from urbanjax.types import ScenarioError, as_arrays, host_record
from urbanjax.vehicle.params import VehicleParams

ENOUGH = 0.8  # of the way that the recorded driver made
LEAST = 2.0  # m, that is asked for at least


@host_record
class RecordedMission:
    """The drives of one recording: in the place of its drivers, with their vehicles, or in its planning problems.

    Success in the place of a driver: 80 % of the way that the driver made, within the time that it took (at most 30 s);
    in a problem: a goal, at the time, speed and heading that it names (within 30 s); both without a violation. Scores
    take the way to there for the expert's. Failure: a violation, or less. Others do not react: somebody who runs into
    the ego from behind is not its fault by the rule. Signals show what the map's programs say at the time of the
    record, and green where it has none; where a route enters and leaves the map its edge does not count.
    """

    scene: RecordedScene
    lanes: LaneTables  # of its map
    goal: np.ndarray  # [E] m, stations
    aim: Aim | None  # [E, ...] of problems

    @property
    def name(self) -> str:
        """That of the scene."""
        return self.scene.name

    @property
    def size(self) -> str:
        """What the shapes of its cases depend on: drives of one scene share a program."""
        return self.scene.name

    @property
    def longest(self) -> float:
        """Duration [s] of its logs."""
        return LONGEST

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
        corridor, ego, replay, own, aim = jax.tree.map(
            lambda x: np.asarray(x[seed]), (scene.corridor, scene.ego, scene.replay, scene.vehicle, self.aim)
        )
        period = scene.recording.dt
        now = start.first * period
        world = world_of(others, ego=ego, link=start.link, replay=replay, signals=scene.signals, time=now)
        asked = {"goal": float(self.goal[seed]), "limit": min((start.steps - 1) * period, LONGEST)}
        return Case(
            corridor, self.lanes, jax.device_get(world), **jax.device_get(as_arrays(asked)), vehicle=own, aim=aim
        )


def recorded_mission(scene: RecordedScene, *, endless: bool = False) -> RecordedMission:
    """The drives of a recording. Raises ScenarioError for a problem whose goal is no station of its route.

    Args: scene, of recorded drivers or of planning problems; endless, whether drives ask for nothing and last as long
    as their record (at most 30 s).
    """
    lanes, count = jax.device_get(tables.from_graph(scene.graph)), len(scene.starts)
    if endless:
        return RecordedMission(scene, lanes, np.full(count, np.inf), None)
    if scene.starts[0].index is None:
        aim = jax.device_get(aims(scene.starts, scene.graph))
        return RecordedMission(scene, lanes, np.array([_of_problem(scene, aim, k) for k in range(count)]), aim)
    return RecordedMission(scene, lanes, np.array([_of_driver(scene, k) for k in range(count)]), None)


def _of_driver(scene: RecordedScene, k: int) -> float:
    """The station that is asked for in the place of a recorded driver."""
    start, recording = scene.starts[k], scene.recording
    corridor = jax.tree.map(lambda x: np.asarray(x[k]), scene.corridor)
    first, end = (
        station(corridor, recording.position[at, start.index], heading=float(recording.heading[at, start.index]))
        for at in (start.first, start.first + start.steps - 1)
    )
    return first + max(ENOUGH * (end - first), LEAST)


def _of_problem(scene: RecordedScene, aim: Aim, k: int) -> float:
    """The station that a problem asks for."""
    start = scene.starts[k]
    corridor, aim = jax.tree.map(lambda x: np.asarray(x[k]), (scene.corridor, aim))
    first = station(corridor, start.pose[:2], heading=float(start.pose[2]))
    begin = start.first * scene.recording.dt
    try:
        there = entry(start, aim, corridor=corridor)
        if aim.time[:, 0].min() > begin + LONGEST:
            raise ScenarioError(f"{start.name}: its goals begin after {LONGEST:g} s, and no drive lasts so long")
    except ScenarioError as error:
        remedy = "leave the recording out, or drive in the place of its drivers"
        raise ScenarioError(f"{scene.name}: {error}; {remedy}") from error
    return max(there, first + LEAST)
