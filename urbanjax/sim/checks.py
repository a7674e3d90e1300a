"""What a run is begun with, checked once before it is compiled: shapes always, values where they are known."""

from typing import Any

import jax
import numpy as np

from urbanjax.roadmap.corridor import Corridor
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.sim.replay import Replay
from urbanjax.sim.world import WorldState
from urbanjax.types import ScenarioError
from urbanjax.types.arguments import traced
from urbanjax.vehicle.params import VehicleParams

FARTHEST = 15.0  # m from the nearest lane's centre, beyond which the ego is not on the road
ROUNDING = 1e-3  # m/s
ASTRAY = 50.0  # m from its route, beyond which the ego cannot be meant to drive there


def check_start(graph: RoadGraph, corridor: Corridor, *, world: WorldState) -> None:
    """Raise ScenarioError for a start that no run can begin with.

    Values are looked at outside jit, vmap and grad only. Args: graph, the road graph; corridor, around the route of the
    ego; world, at the start of one run.
    """
    ego = world.ego
    for name, shape in (("position", (2,)), ("heading", ()), ("speed", ()), ("acceleration", ()), ("steering", ())):
        found = np.shape(getattr(ego, name))
        if found != shape:
            raise ScenarioError(
                f"start.ego.{name} has the shape {found}, not {shape}: a rollout is one run; vmap it over a batch"
            )
    _check_replay(world.replay)
    if traced(ego, world.ego_link, world.time, graph.centre, corridor.position):
        return
    for name in ("position", "heading", "speed", "acceleration", "steering"):
        if not np.isfinite(getattr(ego, name)).all():
            raise ScenarioError(f"start.ego.{name} is {np.asarray(getattr(ego, name))}: it must be finite")
    if not np.isfinite(world.time):
        raise ScenarioError(f"start.time is {float(world.time)}: it must be finite")
    valid = np.asarray(graph.valid)
    if not 0 <= int(world.ego_link) < len(valid) or not valid[int(world.ego_link)]:
        raise ScenarioError(f"start.ego_link is {int(world.ego_link)}: the graph has {int(valid.sum())} links")
    position = np.asarray(ego.position, float)
    away = off_lanes(graph, position)
    if away > FARTHEST:
        raise ScenarioError(
            f"start.ego.position {position.round(1).tolist()} is {away:.0f} m from the nearest lane's centre: begin on "
            f"the road (coordinates are relative to the graph's origin {graph.origin})"
        )
    line = np.asarray(corridor.position, float)[np.asarray(corridor.valid)]
    astray = _distance(position, line[:-1], line[1:])
    if astray > ASTRAY:
        raise ScenarioError(
            f"start.ego.position is {astray:.0f} m from the course's route: begin near it, or plan anew"
        )


def check_drive(world: WorldState, vehicle: VehicleParams, *, params: Any) -> None:
    """Raise ScenarioError for a speed that the vehicle cannot have at the start, and for params of several drives.

    Values are looked at outside jit, vmap and grad only. Args: world, at the start; vehicle, the ego; params, of which
    one set is needed.
    """
    check_one(params)
    speed, fastest = world.ego.speed, vehicle.max_speed
    if not traced(speed, fastest) and not 0 <= float(speed) <= float(fastest) + ROUNDING:
        raise ScenarioError(
            f"start.ego.speed is {float(speed):g} m/s: params.vehicle drives between 0 and {float(fastest):g} m/s"
        )


def off_lanes(graph: RoadGraph, position: np.ndarray) -> float:
    """Distance [m] of a place to the nearest lane's centre. Args: graph, the road graph; position [2] m."""
    lines = np.asarray(graph.centre, float)[np.asarray(graph.valid)]
    return _distance(position, lines[:, :-1].reshape(-1, 2), lines[:, 1:].reshape(-1, 2))


def check_one(params: Any) -> None:
    """Raise ScenarioError for params of several drives. Args: params, of which every leaf is to be one number."""
    if any(np.ndim(leaf) for leaf in jax.tree.leaves(params)):
        raise ScenarioError("params hold a batch: drive one set at a time, or vmap urbanjax.rollout over them")


def _check_replay(replay: Replay | None) -> None:
    if replay is None:
        return
    rows = ("position", "heading", "speed", "valid", "length", "width")
    shapes: dict[str, tuple[int, ...]] = {name: np.shape(getattr(replay, name)) for name in rows}
    table = shapes["heading"] if len(shapes["heading"]) == 2 else (-1, -1)
    wanted = dict.fromkeys(rows, table) | {"position": (*table, 2)} | dict.fromkeys(("length", "width"), table[1:])
    for name, found in shapes.items():
        if found != wanted[name]:
            raise ScenarioError(
                f"replay.{name} has the shape {found}, and heading {shapes['heading']}: T times by V road users are "
                "needed, position [T, V, 2], heading, speed and valid [T, V], length and width [V]"
            )


def _distance(point: np.ndarray, start: np.ndarray, end: np.ndarray) -> float:
    """Distance [m] of a point [2] to the nearest of segments from start [n, 2] to end [n, 2]."""
    along = end - start
    square = np.maximum((along**2).sum(1), np.finfo(float).tiny)
    share = np.clip(((point - start) * along).sum(1) / square, 0, 1)
    return float(np.linalg.norm(start + share[:, None] * along - point, axis=1).min())
