"""Who is replaced in a recording, and where they start (host side)."""

import contextlib
import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.evaluation.recorded.planning_problem import Goal, PlanningProblem
from urbanjax.evaluation.recorded.routes import beside, find_route
from urbanjax.geometry.boxes import box, overlap
from urbanjax.roadmap.corridor import Corridor, CorridorParams, corridor_along, sized
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.roadmap.matching import match, near
from urbanjax.roadmap.route import Route
from urbanjax.sim.recording import Recording
from urbanjax.sim.replay import Replay
from urbanjax.sim.signals import SignalCycle, SignalPhases, phases, stated
from urbanjax.types import RoadUser, RouteError, VehicleState, as_arrays, host_record
from urbanjax.vehicle.params import VehicleParams

ROUNDING = 1e-6  # s, by which a recording may be too short
KINDS = {"pedestrian": RoadUser.PEDESTRIAN, "bicycle": RoadUser.CYCLIST}  # as files name them; others are vehicles
WHEELBASE, OVERHANG = 0.6, 0.2  # of a vehicle's length, where a recording does not say


@host_record
class EgoStart:
    """Where one drive of the stack begins, and how long it lasts."""

    index: int | None  # among the recorded road users, whom it replaces; None for a planning problem
    name: str
    first: int  # step of the recording
    steps: int  # that it lasts
    pose: np.ndarray  # [3] x, y (m), heading (rad) of the box centre
    speed: float  # m/s
    size: tuple[float, float] | None  # m, length and width; None: the stack's own
    link: int
    route: Route
    goals: tuple[Goal, ...] = ()  # of a planning problem


@host_record
class RecordedScene:
    """A recording with all its starts, stacked along the first axis (E of them)."""

    name: str
    graph: RoadGraph
    recording: Recording
    starts: tuple[EgoStart, ...]
    left_out: dict[str, str]  # vehicle -> why
    corridor: Corridor  # [E, ...]
    replay: Replay  # [E, ...], without the ego itself
    ego: VehicleState  # [E, ...]
    vehicle: VehicleParams  # [E, ...]
    cycles: tuple[SignalCycle | None, ...]  # of each signal, None where the map has none

    @property
    def signals(self) -> SignalPhases:
        """By the map's programs; those without one are green."""
        return phases(self.cycles, self.graph.n_signals)

    @property
    def with_program(self) -> int:
        """How many signals the map has a program for; the other ones are shown green."""
        return sum(map(stated, self.cycles))


def prepare(
    name: str,
    graph: RoadGraph,
    *,
    recording: Recording,
    params: CorridorParams,
    shortest: float,
    vehicle: VehicleParams | None = None,
    cycles: Sequence[SignalCycle | None] = (),
) -> RecordedScene:
    """Every recorded motor vehicle that moves, lasts `shortest` s, and overlaps no other in the recording.

    Raises RouteError where there is none. Args: name, of the scene; graph, the road graph; recording, the road users;
    shortest [s]; vehicle, the stack's own (default: the standard one); cycles, of the graph's signals (default: none).
    """
    starts, left_out = [], {}
    touching = _overlapping(recording)
    for v, label in enumerate(str(i) for i in recording.ids):
        steps = int(recording.valid[:, v].sum())
        if recording.standing[v] or recording.kind[v] in KINDS or (steps - 1) * recording.dt < shortest - ROUNDING:
            continue
        other = touching[v]
        if other is not None:
            left_out[label] = f"overlaps {recording.ids[other]} in the recording"
            continue
        try:
            starts.append(replaced(graph, recording, vehicle=v))
        except RouteError as error:
            left_out[label] = str(error)
    scene = _scene(name, graph, recording, starts, left_out, params, vehicle)
    return dataclasses.replace(scene, cycles=tuple(cycles))


def replaced(graph: RoadGraph, recording: Recording, *, vehicle: int) -> EgoStart:
    """The start in the place of one recorded vehicle. Raises RouteError where there is no route.

    Args: graph, the road graph; recording, the road users; vehicle, which of them.
    """
    v = vehicle
    steps = int(recording.valid[:, v].sum())
    first = int(recording.valid[:, v].argmax())
    span = slice(first, first + steps)
    position, heading = recording.position[span, v], recording.heading[span, v]
    links = match(graph, position, heading=heading)
    if links is None:
        raise RouteError("leaves the map")
    # Along the roads that were driven, without the lane changes that can be done without.
    last = int(links[-1])
    return EgoStart(
        index=v,
        name=str(recording.ids[v]),
        first=first,
        steps=steps,
        pose=np.array([*position[0], heading[0]]),
        speed=float(recording.speed[first, v]),
        size=(float(recording.length[v]), float(recording.width[v])),
        link=int(links[0]),
        route=find_route(graph, int(links[0]), goals=(last, *beside(graph, last))),
    )


def problems(
    name: str,
    graph: RoadGraph,
    *,
    recording: Recording,
    tasks: Sequence[PlanningProblem],
    params: CorridorParams,
    vehicle: VehicleParams | None = None,
    cycles: Sequence[SignalCycle | None] = (),
) -> RecordedScene:
    """Planning problems among recorded traffic, each driven as long as its goals or the recording last.

    The goal is a link of a goal, or the nearest one to its region; a problem without either goes on along its lane.
    Raises RouteError where there is none. Args: name, of the scene; graph, the road graph; recording, the road users;
    tasks, the planning problems; vehicle, the stack's own (default: the standard one); cycles, of the graph's signals
    (default: none).
    """
    if not tasks:
        raise RouteError(f"{name}: holds no planning problem; drive in the place of its drivers")
    starts, left_out = [], {}
    for problem in tasks:
        try:
            starts.append(posed(graph, recording, problem=problem))
        except RouteError as error:
            left_out[str(problem.id)] = str(error)
    scene = _scene(name, graph, recording, starts, left_out, params, vehicle)
    return dataclasses.replace(scene, cycles=tuple(cycles))


def posed(graph: RoadGraph, recording: Recording, *, problem: PlanningProblem) -> EgoStart:
    """The start of a planning problem, to the nearest of its goals. Raises RouteError where there is no route.

    Args: graph, the road graph; recording, the road users; problem, of the same file.
    """
    own = near(graph, np.array(problem.position), heading=problem.heading)
    if not own:
        raise RouteError("begins off the road")
    places = [np.array(region.centre) for goal in problem.goals for region in goal.regions]
    goals = [link for goal in problem.goals for link in goal.links]
    goals += [link for place in places for link in near(graph, place, heading=None)[:1]]
    routes: list[tuple[int, Route]] = []
    for link in own:
        with contextlib.suppress(RouteError):
            routes.append((link, find_route(graph, link, goals=goals or (link,))))
    if not routes:
        raise RouteError(f"none of the links {goals} can be reached")
    link, route = min(routes, key=lambda pair: float(pair[1].cost))
    ends = [goal.time[1] for goal in problem.goals if goal.time is not None]
    first = round(problem.time / recording.dt)
    last = max([recording.n_times - 1, *(round(end / recording.dt) for end in ends)])
    pose = np.array([*problem.position, problem.heading])
    return EgoStart(
        None, f"problem {problem.id}", first, last - first + 1, pose, problem.speed, None, link, route, problem.goals
    )


def _scene(
    name: str,
    graph: RoadGraph,
    recording: Recording,
    starts: list[EgoStart],
    left_out: dict[str, str],
    params: CorridorParams,
    vehicle: VehicleParams | None,
) -> RecordedScene:
    if not starts:
        raise RouteError(f"{name}: nobody can be driven there ({left_out or 'none lasts long enough'})")
    sizes = [sized(graph, start.route, params=params) for start in starts]
    largest = params.replace(n_stations=max(s.n_stations for s in sizes), n_stops=max(s.n_stops for s in sizes))
    vehicles = [vehicle_of(start, vehicle or VehicleParams()) for start in starts]
    return RecordedScene(
        name=name,
        graph=graph,
        recording=recording,
        starts=tuple(starts),
        left_out=left_out,
        corridor=stacked([_extend(graph, start.route, params=as_arrays(largest)) for start in starts]),
        replay=stacked([replay_without(recording, start.index) for start in starts]),
        ego=stacked([ego_of(*pair) for pair in zip(starts, vehicles, strict=True)]),
        vehicle=stacked(vehicles),
        cycles=(),
    )


_extend = jax.jit(corridor_along)


def stacked(trees: Sequence[Any]) -> Any:
    """Equal trees along a new first axis. Args: trees, one or more."""
    return jax.tree.map(lambda *x: jnp.stack(x), *trees)


def _overlapping(recording: Recording) -> list[int | None]:
    """For each road user the first other one whose box it overlaps at some time."""
    count = len(recording.ids)
    a, b = np.triu_indices(count, 1)
    size, width = (np.broadcast_to(x, recording.valid.shape) for x in (recording.length, recording.width))
    position, heading, size, width = as_arrays((recording.position, recording.heading, size, width))
    boxes = _box(position, heading, length=size, width=width)
    one, other = (jax.tree.map(lambda x, which=which: x[:, which], boxes) for which in (a, b))
    touch = np.asarray(_overlaps(one, other))
    touch = (touch & recording.valid[:, a] & recording.valid[:, b]).any(0)
    found: list[int | None] = [None] * count
    for i, j in zip(a[touch], b[touch], strict=True):
        for one, other in ((i, j), (j, i)):
            if found[one] is None:
                found[one] = int(other)
    return found


_box, _overlaps = jax.jit(box), jax.jit(overlap)


def replay_without(recording: Recording, index: int | None) -> Replay:
    """The recording as a replay, without one road user.

    Args: recording, the road users; index, of the one to leave out (None: nobody).
    """
    valid = recording.valid.copy()
    if index is not None:
        valid[:, index] = False
    rows: dict[str, Any] = {
        "position": recording.position,
        "heading": recording.heading,
        "speed": recording.speed,
        "length": recording.length,
        "width": recording.width,
        "valid": valid,
        "period": float(recording.dt),
        "kind": np.array([KINDS.get(kind, RoadUser.VEHICLE) for kind in recording.kind], np.int32),
    }
    return Replay(**as_arrays(rows))


def vehicle_of(start: EgoStart, own: VehicleParams) -> VehicleParams:
    """A vehicle of the recorded size, or the stack's own.

    Args: start, with the recorded size; own, the stack's vehicle.
    """
    if start.size is None:
        return as_arrays(own)
    length, width = start.size
    return as_arrays(
        own.replace(wheelbase=WHEELBASE * length, length=length, width=width, rear_overhang=OVERHANG * length)
    )


def ego_of(start: EgoStart, vehicle: VehicleParams) -> VehicleState:
    """The vehicle at the start; the reference point is the rear axle.

    Args: start, with pose and speed of the box centre; vehicle, whose rear axle is asked for.
    """
    heading = float(start.pose[2])
    back = float(vehicle.centre_offset)
    state: dict[str, Any] = {
        "position": start.pose[:2] - back * np.array([np.cos(heading), np.sin(heading)]),
        "heading": heading,
        "speed": max(start.speed, 0.0),
        "acceleration": 0.0,
        "steering": 0.0,
    }
    return VehicleState(**as_arrays(state))
