"""The stack in the place of each recorded driver, or in planning problems, and how it compares."""

from collections.abc import Iterator

import jax
import numpy as np

from urbanjax.evaluation import collisions
from urbanjax.evaluation.batch import CHUNK, Job, Outcome
from urbanjax.evaluation.collisions import Contact
from urbanjax.evaluation.missions.recorded import recorded_mission
from urbanjax.evaluation.recorded import goals
from urbanjax.evaluation.recorded.scenes import RecordedScene
from urbanjax.evaluation.together import Batch, Wanted, together
from urbanjax.rollout import LoopParams
from urbanjax.types import host_record


@host_record
class Drive:
    """One drive of the stack beside the recorded one; arrays over the T steps that it lasts.

    A planning problem has no recorded drive: its way is NaN, its arrays are empty.
    """

    scene: str
    name: str
    contact: Contact
    at_fault: bool
    contact_time: float | None  # s after the start
    contact_with: str | None
    off_road: bool
    way: float  # m along the route, as far as the map goes
    human_way: float  # m
    path: np.ndarray  # [T, 3] x, y (m), heading (rad) of the box centre
    speed: np.ndarray  # [T] m/s
    human_path: np.ndarray  # [T, 3]
    human_speed: np.ndarray  # [T] m/s
    length: float  # m, of the vehicle
    width: float  # m
    period: float  # s
    reached: bool | None = None  # the goal of a planning problem

    @property
    def failure(self) -> str | None:
        """Why the drive does not count as one without an at-fault collision."""
        if not self.at_fault:
            return None
        return f"{self.contact.name.lower()} contact with {self.contact_with} after {self.contact_time:.1f} s"


def batch_of(loop: LoopParams, scene: RecordedScene) -> Batch:
    """All drives of a scene, each as long as its record (at most 30 s), whatever it passes.

    Args: loop, the stack and the simulator; scene, the recording with its starts.
    """
    mission = recorded_mission(scene, endless=True)
    jobs = tuple(Job(mission, k) for k in range(mission.count))
    return Batch(scene.name, (loop,), jobs, traffic="replay", chunk=min(CHUNK, max(len(jobs), 1)), logs=True)


def drive(loop: LoopParams, scene: RecordedScene) -> Iterator[Drive]:
    """The drives of a scene. Args: loop, the stack and the simulator; scene, the recording with its starts."""
    batch = batch_of(loop, scene)
    for came in together([Wanted("", batch, part) for part in batch.parts]):
        if came.error is not None:
            raise came.error
        yield from (read(scene, one) for one in came.outcomes)


def read(scene: RecordedScene, outcome: Outcome) -> Drive:
    """One drive beside the recorded one. Args: scene; outcome, with its log."""
    k, log, vehicle = outcome.job.seed, outcome.log, outcome.vehicle
    assert log is not None
    assert vehicle is not None
    start, recording = scene.starts[k], scene.recording
    n = min(start.steps, len(log.time))
    corridor = jax.tree.map(lambda x: np.asarray(x[k]), scene.corridor)

    def way(path: np.ndarray) -> float:
        first, last = (goals.station(corridor, path[i, :2], heading=float(path[i, 2])) for i in (0, -1))
        return last - first

    human, speeds = np.zeros((0, 3)), np.zeros(0)
    if start.index is not None:
        span = slice(start.first, start.first + n)
        human = np.column_stack([recording.position[span, start.index], recording.heading[span, start.index]])
        speeds = recording.speed[span, start.index]
    # Beyond the end of the record the last step is held: nothing happens any more.
    held = np.minimum(np.arange(len(log.time)), n - 1)
    collision = jax.device_get(_first(jax.tree.map(lambda x: x[held], log), vehicle))
    touched = int(collision.contact) != Contact.NONE
    path, speed = np.column_stack([log.centre, log.ego.heading])[:n], np.asarray(log.ego.speed)[:n]
    period = float(recording.dt)
    return Drive(
        scene=scene.name,
        name=start.name,
        contact=Contact(int(collision.contact)),
        at_fault=bool(collision.at_fault),
        contact_time=float(log.time[int(collision.step)] - log.time[0]) if touched else None,
        contact_with=str(recording.ids[int(collision.other) - 1]) if touched else None,
        off_road=bool(outcome.row["competition_off_road"] > 0),
        way=way(path),
        human_way=way(human) if len(human) else float("nan"),
        path=path,
        speed=speed,
        human_path=human,
        human_speed=speeds,
        length=float(vehicle.length),
        width=float(vehicle.width),
        period=period,
        reached=goals.reached(start, scene.graph, path=path, speed=speed, period=period) if start.goals else None,
    )


_first = jax.jit(collisions.first)
