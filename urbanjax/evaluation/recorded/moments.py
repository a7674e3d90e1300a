"""Demonstrations of recorded drivers: where each was at moments of its drive, and what it did next (host side)."""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from urbanjax.course import Course
from urbanjax.evaluation.recorded.demonstration import Demonstration
from urbanjax.evaluation.recorded.scenes import EgoStart, RecordedScene
from urbanjax.evaluation.recorded.worlds import world_of
from urbanjax.numerics.compiling import compiler_options
from urbanjax.planning.situation import Situation, look
from urbanjax.roadmap.progress import progress
from urbanjax.rollout import LoopParams
from urbanjax.sim import lanes as tables
from urbanjax.sim import world as worlds
from urbanjax.sim.recording import Recording
from urbanjax.types import VehicleState, as_arrays, host_record

SPACING = 0.2  # s, of the driven times: a multiple of the periods of all recordings
LONGEST = 8.0  # s, of what is kept of a drive after the moment: the horizon of the macro plan
LEAST_HISTORY, HISTORY = 0.5, 1.0  # s before a moment, from which acceleration and steering are told
LEAST_WAY = 1.0  # m, of less no curvature is told
AT_ONCE = 16  # situations that are looked at at once


@host_record
class Demonstrations:
    """N demonstrations of a scene, and whose each is."""

    scene: str
    driver: tuple[str, ...]  # [N] scene and vehicle
    step: np.ndarray  # [N] int, of the recording
    speed: np.ndarray  # [N] m/s
    every: Demonstration  # [N, ...]


class _Moment(NamedTuple):
    start: int
    step: int


def demonstrations(params: LoopParams, scene: RecordedScene, *, future: float, apart: float) -> Demonstrations:
    """Each driver's moments, `apart` s from one another, with `future` s of its record to come and half a second past.

    Acceleration and steering are those of the second before (or what there is of it), since recordings state neither.
    Args: params, of the stack and what it observes; scene, with recorded drivers; future [s]; apart [s].
    """
    recording = scene.recording
    found = [
        _Moment(k, step)
        for k, start in enumerate(scene.starts)
        for step in _steps(start, recording.dt, future=future, apart=apart)
    ]
    states = [_state(scene, moment) for moment in found]
    situations = _look(params, scene, found, states)
    driven = [_driven(recording, scene.starts[m.start], m.step) for m in found]
    rows: dict[str, Any] = {name: np.stack([one[name] for one in driven]) for name in ("position", "heading")}
    owner = np.array([m.start for m in found])
    every = Demonstration(
        situation=situations,
        vehicle=jax.tree.map(lambda x: x[owner], scene.vehicle),
        time=as_arrays(jnp.asarray(np.tile(_times(), (len(found), 1)))),
        **as_arrays(rows),
        valid=jnp.asarray(np.stack([one["valid"] for one in driven])),
    )
    return Demonstrations(
        scene=scene.name,
        driver=tuple(f"{scene.name} {scene.starts[m.start].name}" for m in found),
        step=np.array([m.step for m in found]),
        speed=np.array([state["speed"] for state in states]),
        every=jax.device_get(every),
    )


def _times() -> np.ndarray:
    return SPACING * np.arange(1, round(LONGEST / SPACING) + 1)


def _steps(start: EgoStart, dt: float, *, future: float, apart: float) -> range:
    """The steps of one driver that are moments."""
    first = start.first + math.ceil(LEAST_HISTORY / dt - 1e-6)
    last = start.first + start.steps - 1 - round(future / dt)
    return range(first, last + 1, max(round(apart / dt), 1))


def _state(scene: RecordedScene, moment: _Moment) -> dict[str, Any]:
    """The state of the rear axle at a moment, by what is known of the drive up to then."""
    start, recording = scene.starts[moment.start], scene.recording
    now, v = moment.step, start.index
    past = slice(max(start.first, now - round(HISTORY / recording.dt)), now + 1)
    heading, speed, position = (x[past, v] for x in (recording.heading, recording.speed, recording.position))
    way = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(position, axis=0), axis=-1))]
    time = recording.dt * np.arange(len(speed))
    curvature = np.polyfit(way, np.unwrap(heading), 1)[0] if way[-1] > LEAST_WAY else 0.0
    vehicle = jax.tree.map(lambda x: float(x[moment.start]), scene.vehicle)
    towards = np.array([np.cos(heading[-1]), np.sin(heading[-1])])
    steering = np.arctan(vehicle.wheelbase * curvature)
    return {
        "position": position[-1] - vehicle.centre_offset * towards,
        "heading": heading[-1],
        "speed": max(float(speed[-1]), 0.0),
        "acceleration": float(np.polyfit(time, speed, 1)[0]),
        "steering": float(np.clip(steering, -vehicle.max_steering, vehicle.max_steering)),
    }


def _driven(recording: Recording, start: EgoStart, step: int) -> dict[str, np.ndarray]:
    """What the driver did after a step; beyond the record its last state is held, and is not valid."""
    at = step + np.round(_times() / recording.dt).astype(int)
    last = start.first + start.steps - 1
    held = np.minimum(at, last)
    return {
        "position": recording.position[held, start.index],
        "heading": recording.heading[held, start.index],
        "valid": at <= last,
    }


def _look(params: LoopParams, scene: RecordedScene, found: list[_Moment], states: list[dict[str, Any]]) -> Situation:
    """The situations [N, ...], as the stack would see them."""
    stack, sim = as_arrays(params).handed_down()
    lanes = tables.from_graph(scene.graph)
    rows: dict[str, Any] = {name: np.stack([state[name] for state in states]) for name in states[0]}
    egos = VehicleState(**as_arrays(rows))
    owner = np.array([m.start for m in found])
    time = np.array([m.step * scene.recording.dt for m in found])
    links = jnp.asarray([scene.starts[m.start].link for m in found], jnp.int32)

    def one(row: tuple[Array, VehicleState, Array, Array]) -> Situation:
        k, ego, link, now = row
        corridor, replay, vehicle = jax.tree.map(lambda x: x[k], (scene.corridor, scene.replay, scene.vehicle))
        world = world_of(sim.traffic, ego=ego, link=0, replay=replay, signals=scene.signals, time=0.0)
        world = world.replace(time=now, ego_link=link)
        observation = worlds.observe(sim.replace(vehicle=vehicle), lanes, world=world)
        station = progress(corridor, ego.position, heading=ego.heading).station
        course = Course(lanes.graph, corridor)
        found = look(stack.situation, course, station=station, ego=ego, observation=observation)
        return found.replace(signals=None)  # planning reads none, and there may be none of them

    every = jax.jit(lambda rows: jax.lax.map(one, rows, batch_size=AT_ONCE), compiler_options=compiler_options())
    return every((jnp.asarray(owner), egos, links, as_arrays(jnp.asarray(time))))
