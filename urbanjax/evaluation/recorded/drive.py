"""The closed loop in the place of each recorded driver, and how it compares with them."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from urbanjax.course import Course
from urbanjax.evaluation import collisions, metrics
from urbanjax.evaluation.collisions import Collision, Contact
from urbanjax.evaluation.recorded import goals
from urbanjax.evaluation.recorded.scenes import RecordedScene, stacked
from urbanjax.evaluation.recorded.worlds import world_of
from urbanjax.numerics.compiling import compiler_options
from urbanjax.roadmap.corridor import Corridor
from urbanjax.roadmap.progress import progress
from urbanjax.rollout import LoopParams, rollout
from urbanjax.sim import lanes as tables
from urbanjax.sim.lanes import LaneTables
from urbanjax.sim.log import Log
from urbanjax.sim.world import WorldState
from urbanjax.types import as_arrays, host_record
from urbanjax.vehicle.params import VehicleParams

INSIDE = 1.0  # m from the edge of the road, where nobody knows where that is: up to here from the ends of the map


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


def drive(loop: LoopParams, scene: RecordedScene) -> list[Drive]:
    """All drives of a scene, in one compiled program.

    Args: loop, the stack and the simulator; scene, the recording with its starts.
    """
    lanes = tables.from_graph(scene.graph)
    steps = np.array([start.steps for start in scene.starts])
    loop = as_arrays(loop)
    worlds = worlds_of(loop, scene)
    program = jax.jit(_all, static_argnames="n_steps", compiler_options=compiler_options())
    out = program(
        loop, scene.graph, lanes, scene.corridor, worlds, scene.vehicle, jnp.asarray(steps), n_steps=int(steps.max())
    )
    out = jax.device_get(out)
    return [_read(scene, k, *jax.tree.map(lambda x, k=k: x[k], out)) for k in range(len(steps))]


def worlds_of(loop: LoopParams, scene: RecordedScene) -> WorldState:
    """The worlds at the starts, [E, ...]: recorded road users only.

    Args: loop, the simulator's parameters; scene, the recording with its starts.
    """
    worlds = []
    for k, start in enumerate(scene.starts):
        ego, replay = jax.tree.map(lambda x, k=k: x[k], (scene.ego, scene.replay))
        time = start.first * scene.recording.dt
        worlds.append(
            world_of(loop.sim.traffic, ego=ego, link=start.link, replay=replay, signals=scene.signals, time=time)
        )
    return stacked(worlds)


def _all(
    loop: LoopParams,
    graph: Any,
    lanes: LaneTables,
    corridor: Corridor,
    starts: WorldState,
    vehicles: VehicleParams,
    steps: Array,
    n_steps: int,
) -> tuple[Log, Collision, Array, Array]:
    def one(corridor: Corridor, start: WorldState, vehicle: VehicleParams, count: Array) -> tuple:
        own = loop.replace(vehicle=vehicle)
        log, _ = rollout(own, Course(graph, corridor), lanes, start, n_steps)
        # Beyond the end of the record the last step is held: nothing happens any more.
        held = jnp.minimum(jnp.arange(n_steps), count - 1)
        log = jax.tree.map(lambda x: x[held], log)
        station = jax.vmap(lambda p, h: progress(corridor, p, heading=h).station)(log.centre, log.ego.heading)
        # Where the route enters and leaves the map nobody knows where the road is.
        reach = vehicle.length / 2 + INSIDE
        mapped = (station > reach) & (station + reach < corridor.length)
        margin = jnp.where(mapped, log.road_margin, INSIDE)
        off = metrics.off_road(log.replace(road_margin=margin), own.stack.relaxation) > 0.5  # a degree in [0, 1]
        return log, collisions.first(log, vehicle), off, jnp.minimum(station, corridor.length)

    return jax.vmap(one)(corridor, starts, vehicles, steps)


def _read(scene: RecordedScene, k: int, log: Log, collision: Collision, off_road: Any, station: Any) -> Drive:
    start, recording = scene.starts[k], scene.recording
    n, span = start.steps, slice(start.first, start.first + start.steps)
    human, speeds, human_way = np.zeros((0, 3)), np.zeros(0), float("nan")
    if start.index is not None:
        human = np.column_stack([recording.position[span, start.index], recording.heading[span, start.index]])
        speeds = recording.speed[span, start.index]
        corridor = jax.tree.map(lambda x: x[k], scene.corridor)
        first, last = (float(_station(corridor, *as_arrays((human[i, :2], human[i, 2])))) for i in (0, -1))
        human_way = last - first
    path = np.column_stack([log.centre, log.ego.heading])[:n]
    speed = np.asarray(log.ego.speed)[:n]
    touched = int(collision.contact) != Contact.NONE
    return Drive(
        scene=scene.name,
        name=start.name,
        contact=Contact(int(collision.contact)),
        at_fault=bool(collision.at_fault),
        contact_time=float(log.time[int(collision.step)] - log.time[0]) if touched else None,
        contact_with=str(recording.ids[int(collision.other) - 1]) if touched else None,
        off_road=bool(off_road),
        way=float(station[n - 1] - station[0]),
        human_way=human_way,
        path=path,
        speed=speed,
        human_path=human,
        human_speed=speeds,
        length=float(jnp.asarray(scene.vehicle.length)[k]),
        width=float(jnp.asarray(scene.vehicle.width)[k]),
        period=float(recording.dt),
        reached=goals.reached(start, scene.graph, path=path, speed=speed, period=float(recording.dt))
        if start.goals
        else None,
    )


@jax.jit
def _station(corridor: Corridor, position: Array, heading: Array) -> Array:
    return jnp.minimum(progress(corridor, position, heading=heading).station, corridor.length)
