"""From a map to a drive on it: course, tables and start, by the ids of the map."""

import dataclasses
import functools
from collections.abc import Hashable, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from urbanjax.course import Course
from urbanjax.evaluation.recorded import goals, scenes
from urbanjax.evaluation.recorded.routes import find_route
from urbanjax.evaluation.recorded.scenes import EgoStart
from urbanjax.evaluation.recorded.worlds import world_of
from urbanjax.io.maps.reading import read
from urbanjax.io.maps.road import RoadMap
from urbanjax.numerics.compiling import compiler_options
from urbanjax.roadmap.corridor import CorridorParams, corridor_along, sized
from urbanjax.roadmap.route import RouteParams, route_between
from urbanjax.rollout import LoopParams, rollout
from urbanjax.sim import lanes as tables
from urbanjax.sim.checks import check_one
from urbanjax.sim.lanes import LaneTables
from urbanjax.sim.log import Log, check
from urbanjax.sim.recording import record
from urbanjax.sim.signals import phases
from urbanjax.sim.world import WorldState
from urbanjax.types import ConfigError, RouteError, ScenarioError, as_arrays, host_record
from urbanjax.types.arguments import kind, number

DURATION = 20.0  # s, of a drive that nothing else ends
LINKS = 256  # of a route between two lanes
MOST_STEPS = 100_000  # of a drive
SHOWN = 12  # names in a message


@host_record
class Scene:
    """One drive on a map: `urbanjax.rollout(scene.params, scene.course, scene.lanes, scene.start, scene.n_steps)`."""

    name: str
    map: RoadMap
    params: LoopParams  # with the vehicle that is driven, and the period of the recording
    course: Course
    lanes: LaneTables
    start: WorldState
    n_steps: int
    ego: EgoStart  # where it starts, and its goals

    @property
    def names(self) -> tuple[str, ...]:
        """Who stands in the columns of `evaluation.tracks`: the ego, nobody, and the recorded vehicles by id."""
        recorded = () if self.map.recording is None else self.map.recording.ids
        return ("ego", "nobody", *map(str, recorded))

    def drive(self, params: LoopParams | None = None) -> Log:
        """The closed loop, compiled: the log of T = n_steps steps. Args: params, others than the scene's own."""
        return _program()(
            self.params if params is None else self._checked(params),
            self.course,
            self.lanes,
            self.start,
            n_steps=self.n_steps,
        )[0]

    def _checked(self, params: LoopParams) -> LoopParams:
        """The params as arrays. Raises as `scene` does for those of another kind, of a batch or at another period."""
        kind(params, "params", wanted=LoopParams, error=ConfigError)
        return as_arrays(_loop(self.map, params))

    def reached(self, log: Log) -> bool | None:
        """Whether a goal of the planning problem holds at some step; None where there is no goal.

        Raises ScenarioError for what is no log of one run. Args: log [T].
        """
        check(log)
        if not self.ego.goals:
            return None
        path = np.column_stack([log.centre, log.ego.heading])
        period = float(self.params.period)
        return goals.reached(self.ego, self.map.graph, path=path, speed=np.asarray(log.ego.speed), period=period)


def scene(
    map: RoadMap | str | Path,
    *,
    problem: int | np.integer | None = None,
    vehicle: Hashable | None = None,
    lane: Hashable | None = None,
    goal: Hashable | None = None,
    duration: float | None = None,
    params: LoopParams | None = None,
) -> Scene:
    """A drive on a map, by what the map calls things: a planning problem, a recorded vehicle's place, or a lane.

    Recorded road users move as they did; signals show what the map's programs say, and green where it has none.
    Without a choice it is the first planning problem. A recorded vehicle keeps its size; that of a problem is the one
    of `params`; on a lane the drive begins at its start, standing. Args: map, as read, or its file; problem, its place
    in the file from 0 or its id; vehicle, id of a recorded one that the stack drives in the place of; lane, id of one
    to start on, and goal, of one to reach (default: on along the lane); duration [s] (default: of the record, to the
    latest goal, or 20); params, of the loop (default: at the recording's period). After the record none of its road
    users is there. Raises ScenarioError for what the map does not have, RouteError where there is no way.
    """
    found = map if isinstance(map, RoadMap) else read(map)
    if params is not None:
        kind(params, "params", wanted=LoopParams, error=ConfigError)
    if duration is not None:
        number(duration, "duration", error=ScenarioError)
    if sum(given is not None for given in (problem, vehicle, lane)) > 1:
        raise ScenarioError("scene: give one of problem, vehicle and lane")
    if goal is not None and lane is None:
        raise ScenarioError("scene: 'goal' belongs to 'lane', where the drive starts")
    loop = _loop(found, params)
    period = float(loop.period)
    if lane is not None:
        start = _on_lane(found, lane, goal, period)
    elif vehicle is not None:
        start = _of_vehicle(found, vehicle)
    else:
        start = _of_problem(found, 0 if problem is None else problem, period)
    n_steps = start.steps if duration is None else _steps(duration, period)
    own = scenes.vehicle_of(start, loop.vehicle)
    how = as_arrays(sized(found.graph, start.route, params=CorridorParams()))
    replay = None if found.recording is None else scenes.replay_without(found.recording, start.index)
    world = world_of(
        loop.sim.traffic,
        ego=scenes.ego_of(start, own),
        link=start.link,
        replay=replay,
        signals=phases(found.cycles, found.graph.n_signals),
        time=start.first * period,
    )
    return Scene(
        name=f"{found.path.stem}, {start.name}",
        map=found,
        params=as_arrays(loop.replace(vehicle=own)),
        course=Course(found.graph, _extend(found.graph, start.route, params=how)),
        lanes=tables.from_graph(found.graph),
        start=world,
        n_steps=n_steps,
        ego=start,
    )


@functools.cache
def _program() -> Any:
    return jax.jit(rollout, static_argnames="n_steps", compiler_options=compiler_options())


_extend = jax.jit(corridor_along)


def _steps(duration: float, period: float) -> int:
    """Steps of a drive of that duration. Raises ScenarioError where there are fewer than two, or more than can be."""
    if duration > MOST_STEPS * period:
        raise ScenarioError(f"scene: 'duration' is {duration:g} s, and a drive may last {MOST_STEPS * period:g} s")
    n_steps = round(duration / period) + 1
    if n_steps < 2:
        raise ScenarioError(f"scene: a drive of {n_steps} steps of {period} s; give a longer 'duration'")
    return n_steps


def _loop(found: RoadMap, params: LoopParams | None) -> LoopParams:
    """The loop at the recording's period. Raises ScenarioError where it has another one."""
    recorded = None if found.recording is None else float(found.recording.dt)
    if params is not None:
        check_one((params.period, params.vehicle, params.stack))
    if params is None:
        return LoopParams() if recorded is None else LoopParams(period=recorded)
    if recorded is not None and abs(float(params.period) - recorded) > 1e-6:
        raise ScenarioError(
            f"{found.path}: was recorded every {recorded} s, and params.period is {float(params.period):g} s: set it so"
        )
    return params


def _of_vehicle(found: RoadMap, vehicle: Hashable) -> EgoStart:
    recording = found.recording
    if recording is None:
        raise ScenarioError(f"{found.path}: holds no recorded vehicle; give 'lane', or a map with traffic")
    names = [str(name) for name in recording.ids]
    if str(vehicle) not in names:
        raise ScenarioError(f"{found.path}: no recorded vehicle is {vehicle!r}; there are {_listed(names)}")
    v = names.index(str(vehicle))
    if recording.standing[v] or recording.valid[:, v].sum() < 2:
        raise ScenarioError(f"{found.path}: vehicle {vehicle!r} does not move or was recorded once; take another one")
    try:
        return scenes.replaced(found.graph, recording, vehicle=v)
    except RouteError as error:
        raise RouteError(f"{found.path}: vehicle {vehicle!r}: {error}") from error


def _of_problem(found: RoadMap, problem: Any, period: float) -> EgoStart:
    names = [str(task.id) for task in found.problems]
    if not names:
        other = "'lane'" if found.recording is None else "'vehicle' or 'lane'"
        raise ScenarioError(f"{found.path}: holds no planning problem; give {other}")
    by_place = isinstance(problem, int | np.integer) and not isinstance(problem, bool) and 0 <= problem < len(names)
    if not by_place and str(problem) not in names:
        raise ScenarioError(f"{found.path}: no planning problem is {problem!r}; there are {_listed(names)}")
    task = found.problems[problem if by_place else names.index(str(problem))]
    recording = found.recording or record([], period, origin=found.graph.origin)
    try:
        start = scenes.posed(found.graph, recording, problem=task)
    except RouteError as error:
        raise RouteError(f"{found.path}: planning problem {task.id}: {error}") from error
    return start if start.steps > 1 else dataclasses.replace(start, steps=round(DURATION / period) + 1)


def _on_lane(found: RoadMap, lane: Hashable, goal: Hashable | None, period: float) -> EgoStart:
    names = [str(name) for name in found.ids]
    for name in (lane, *(() if goal is None else (goal,))):
        if str(name) not in names:
            raise ScenarioError(f"{found.path}: no lane is {name!r}; there are {_listed(names)}")
    graph, link = found.graph, names.index(str(lane))
    if goal is None:
        route = find_route(graph, link, goals=(link,))
    else:
        try:
            route = route_between(graph, link, goal=names.index(str(goal)), params=RouteParams(n_links=LINKS))
        except RouteError as error:
            raise RouteError(f"{found.path}: lane {goal!r} cannot be reached from lane {lane!r}") from error
    pose = np.array([*np.asarray(graph.centre)[link, 0], np.asarray(graph.heading)[link, 0]], float)
    steps = round(DURATION / period) + 1
    return EgoStart(None, f"lane {lane}", 0, steps, pose, 0.0, None, link, route)


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(names[:SHOWN]) + more
