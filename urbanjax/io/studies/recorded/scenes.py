"""Who is replaced in a recording, where they start, and the route that they are given (host side)."""

import contextlib
import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.geometry.boxes import overlap
from urbanjax.io.maps import Recording, RoadMap
from urbanjax.io.studies.recorded.matching import match
from urbanjax.roadmap.extended import ExtendedGraph, ExtendParams, extend, sized
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.roadmap.route import Route, RouteParams, route_between
from urbanjax.sim.replay import Replay
from urbanjax.types import RouteError, VehicleState, as_arrays
from urbanjax.vehicle.params import VehicleParams

AHEAD = 200.0  # m, for which a route goes on beyond where the recorded drive ends
WHEELBASE, OVERHANG = 0.6, 0.2  # of a vehicle's length, where a recording does not say
LONG_ROUTE = 64  # links


@dataclasses.dataclass(frozen=True)
class Start:
    """One recorded drive that the stack is to repeat."""

    index: int  # among the recorded road users
    name: str
    first: int  # step at which its record begins
    steps: int  # that it lasts
    route: Route
    links: np.ndarray  # [n] that the recorded vehicle drove on


@dataclasses.dataclass(frozen=True)
class Scene:
    """A recording with all its starts, stacked along the first axis (E of them)."""

    name: str
    graph: RoadGraph
    recording: Recording
    starts: tuple[Start, ...]
    left_out: dict[str, str]  # vehicle -> why
    extended: ExtendedGraph  # [E, ...]
    replay: Replay  # [E, ...], without the ego itself
    ego: VehicleState  # [E, ...]
    vehicle: VehicleParams  # [E, ...]


def prepare(road: RoadMap, params: ExtendParams, shortest: float) -> Scene:
    """Every recorded vehicle that moves, lasts `shortest` s, and overlaps no other in the recording."""
    recording = road.recording
    mine, left_out = [], {}
    touching = _overlapping(recording)
    for v, name in enumerate(str(i) for i in recording.ids):
        steps = int(recording.valid[v].sum())
        if recording.standing[v] or (steps - 1) * recording.dt < shortest - 1e-6:
            continue
        if touching[v] is not None:
            left_out[name] = f"overlaps {recording.ids[touching[v]]} in the recording"
            continue
        first = int(recording.valid[v].argmax())
        span = slice(first, first + steps)
        links = match(road.graph, recording.position[v, span], recording.heading[v, span])
        if links is None:
            left_out[name] = "leaves the map"
            continue
        try:
            route = find_route(road.graph, links)
        except RouteError as error:
            left_out[name] = f"no route: {error}"
            continue
        mine.append(Start(v, name, first, steps, route, links))
    if not mine:
        raise RouteError(f"{road.path}: no recorded vehicle can be replaced ({left_out or 'none lasts long enough'})")
    sizes = [sized(road.graph, start.route, params) for start in mine]
    largest = params.replace(n_stations=max(s.n_stations for s in sizes), n_stops=max(s.n_stops for s in sizes))
    tables = [_extend(road.graph, start.route, as_arrays(largest)) for start in mine]
    return Scene(
        name=road.path.stem,
        graph=road.graph,
        recording=recording,
        starts=tuple(mine),
        left_out=left_out,
        extended=_stack(tables),
        replay=_stack([replay_without(recording, start.index) for start in mine]),
        ego=_stack([ego_of(recording, start) for start in mine]),
        vehicle=_stack([vehicle_of(recording, start.index) for start in mine]),
    )


def find_route(graph: RoadGraph, links: np.ndarray) -> Route:
    """The route along the roads that were driven, without the lane changes that it can do without.

    From the first link to the last one or a lane beside it, whichever costs least, and on for 200 m. Raises
    RouteError where none of these can be reached.
    """
    params = RouteParams(n_links=LONG_ROUTE)
    start, goal = int(links[0]), int(links[-1])
    found: list[Route] = []
    for lane in (goal, *_beside(graph, goal)):
        with contextlib.suppress(RouteError):
            found.append(route_between(graph, start, lane, params=params))
    if not found:
        raise RouteError(f"neither link {goal} nor a lane beside it can be reached from link {start}")
    best = min(found, key=lambda route: float(route.cost))
    last = int(best.link[int(best.valid.sum()) - 1])
    beyond = _onwards(graph, last)
    if beyond == last:
        return best
    via = () if last == start else (last,)
    return route_between(graph, start, beyond, via, params=params)


def _beside(graph: RoadGraph, link: int) -> list[int]:
    """The lanes beside a link in its direction."""
    lanes = []
    for side, there in ((graph.left_link, graph.has_left), (graph.right_link, graph.has_right)):
        at = link
        while bool(there[at]) and int(side[at]) not in (link, *lanes):
            at = int(side[at])
            lanes.append(at)
    return lanes


def _onwards(graph: RoadGraph, link: int) -> int:
    """The link 200 m further on, or the last one before the map ends; at forks the one that turns least."""
    way, seen = 0.0, {link}
    while way < AHEAD:
        options = [int(s) for s, has in zip(graph.successor[link], graph.has_successor[link], strict=True) if has]
        options = [s for s in options if s not in seen]
        if not options:
            break
        link = min(options, key=lambda s: abs(float(graph.heading[s, -1] - graph.heading[s, 0])))
        seen.add(link)
        way += float(graph.length[link])
    return link


_extend = jax.jit(extend)


def _stack(trees: list[Any]) -> Any:
    return jax.tree.map(lambda *x: jnp.stack(x), *trees)


def _overlapping(recording: Recording) -> list[int | None]:
    """For each road user the first other one whose box it overlaps at some time."""
    count = len(recording.ids)
    a, b = np.triu_indices(count, 1)
    steps = np.arange(recording.n_times)
    size = np.broadcast_to(recording.length[:, None], (count, len(steps)))
    width = np.broadcast_to(recording.width[:, None], (count, len(steps)))
    boxes = (recording.position, recording.heading, size, width)
    touch = np.asarray(_overlaps(*as_arrays(tuple(x[a] for x in boxes)), *as_arrays(tuple(x[b] for x in boxes))))
    touch = (touch & recording.valid[a] & recording.valid[b]).any(1)
    found: list[int | None] = [None] * count
    for i, j in zip(a[touch], b[touch], strict=True):
        for one, other in ((i, j), (j, i)):
            if found[one] is None:
                found[one] = int(other)
    return found


_overlaps = jax.jit(overlap)


def replay_without(recording: Recording, index: int) -> Replay:
    """The recording as a replay, without one road user."""
    valid = recording.valid.T.copy()
    valid[:, index] = False
    rows: dict[str, Any] = {
        "position": recording.position.transpose(1, 0, 2),
        "heading": recording.heading.T,
        "speed": recording.speed.T,
        "length": recording.length,
        "width": recording.width,
        "valid": valid,
        "period": float(recording.dt),
    }
    return Replay(**as_arrays(rows))


def vehicle_of(recording: Recording, index: int) -> VehicleParams:
    """A vehicle of the recorded size."""
    length = float(recording.length[index])
    return as_arrays(
        VehicleParams(
            wheelbase=WHEELBASE * length,
            length=length,
            width=float(recording.width[index]),
            rear_overhang=OVERHANG * length,
        )
    )


def ego_of(recording: Recording, start: Start) -> VehicleState:
    """The recorded vehicle at its first step; the reference point is the rear axle."""
    v, t = start.index, start.first
    heading = float(recording.heading[v, t])
    back = (0.5 - OVERHANG) * float(recording.length[v])
    centre = recording.position[v, t]
    state: dict[str, Any] = {
        "position": centre - back * np.array([np.cos(heading), np.sin(heading)]),
        "heading": heading,
        "speed": max(float(recording.speed[v, t]), 0.0),
        "acceleration": 0.0,
        "steering": 0.0,
    }
    return VehicleState(**as_arrays(state))
