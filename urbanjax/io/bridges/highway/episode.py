"""One drive in highway-env, and what it amounts to."""

import dataclasses
from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import numpy as np

from urbanjax.io.bridges.highway.environment import EGO_COLOUR, FREQUENCY
from urbanjax.io.bridges.highway.network import continuations
from urbanjax.types import Objects


@runtime_checkable
class EnvironmentDriver(Protocol):
    """Who drives the ego."""

    step_seconds: list[float]  # wall time of each decision

    def start(self, env: Any) -> None:
        """Take the wheel after a reset."""

    def act(self, env: Any) -> np.ndarray | None:
        """The action of this step, None where the vehicle in the environment decides for itself."""


@dataclasses.dataclass
class Episode:
    """One drive, sampled at 15 Hz; y points up as everywhere outside highway-env."""

    env: str
    driver: str
    seed: int
    nominal: float  # s, the time it was meant to last; less where the road ended before
    time: np.ndarray  # [N] s
    position: np.ndarray  # [N, 2] m, centre of the ego
    heading: np.ndarray  # [N] rad
    speed: np.ndarray  # [N] m/s
    on_road: np.ndarray  # [N] bool
    others: Objects  # [N, V] every vehicle and obstacle that was met; NaN and not valid while it is not there
    collision: bool
    step_seconds: list[float]
    frames: list[np.ndarray]  # RGB pictures, if any were asked for
    arrived: bool | None = None  # on the last road of the ego's route; None where it has no route

    @property
    def distance(self) -> float:
        """Metres driven along the ego's own track."""
        return float(np.sum(np.linalg.norm(np.diff(self.position, axis=0), axis=-1)))

    @property
    def mean_speed(self) -> float:
        """Distance over nominal duration in m/s, so a crash costs the distance that it prevents."""
        return self.distance / self.nominal


class Idm:
    """highway-env's own vehicle as the driver: IDM along the lane, MOBIL across."""

    def __init__(self, change_lanes: bool = True):
        """Drive with or without lane changes."""
        self.change_lanes = change_lanes
        self.step_seconds: list[float] = []

    def start(self, env: Any) -> None:
        """Replace the ego."""
        from urbanjax.io.bridges.highway.environment import make_idm

        make_idm(env, self.change_lanes)

    def act(self, env: Any) -> None:
        """Nothing: the vehicle acts when the road is stepped."""


def drive(
    env: Any,
    name: tuple[str, str],
    *,
    driver: EnvironmentDriver,
    seed: int,
    duration: float,
    frame_every: int = 0,
    tick: Callable[[int], None] = lambda steps: None,
) -> Episode:
    """One episode of `driver` in `env`: until `duration` s, a collision, off the road where that ends it, or its end.

    Args: env, an open environment; name, of the environment and of the driver; driver of the ego; seed of the reset;
    duration [s]; frame_every, steps between pictures (0: none); tick, told the number of steps done after each.
    """
    env.reset(seed=seed)
    goal = env.vehicle.route[-1][:2] if env.vehicle.route else None
    arrived = None if goal is None else False
    driver.start(env)
    env.vehicle.color = EGO_COLOUR
    steps, frames, ended = round(duration * FREQUENCY), [], False
    rows, scenes = [_row(env, 0)], [_scene(env)]
    for step in range(1, steps + 1):
        if frame_every and (step - 1) % frame_every == 0:
            frames.append(env.render())
        _, _, terminated, _, _ = env.step(driver.act(env))
        rows.append(_row(env, step))
        scenes.append(_scene(env))
        tick(step)
        arrived = arrived if goal is None else arrived or env.vehicle.lane_index[:2] == goal
        ended = _road_ends(env) or (terminated and not env.vehicle.crashed and env.vehicle.on_road)
        if terminated or ended:
            break
    columns = [np.asarray(column) for column in zip(*rows, strict=True)]
    nominal = float(columns[0][-1]) if ended else duration
    crashed, seconds = bool(env.vehicle.crashed), list(driver.step_seconds)
    return Episode(*name, seed, nominal, *columns, _tracks(scenes), crashed, seconds, frames, arrived)


def _row(env: Any, step: int) -> tuple:
    ego = env.vehicle
    position = ego.position * np.array([1.0, -1.0])
    return step / FREQUENCY, position, -float(ego.heading), float(ego.speed), bool(ego.on_road)


def _scene(env: Any) -> dict[Any, tuple]:
    """Where everything solid but the ego is, and its speed, length and width; y up."""
    things = [thing for thing in [*env.road.vehicles, *env.road.objects] if thing is not env.vehicle and thing.solid]
    return {t: (t.position[0], -t.position[1], -t.heading, t.speed, t.LENGTH, t.WIDTH) for t in things}


def _tracks(scenes: list[dict[Any, tuple]]) -> Objects:
    """The scenes over time [N, V]: one column for each thing, whenever it came and went."""
    columns = {thing: i for i, thing in enumerate(dict.fromkeys(thing for scene in scenes for thing in scene))}
    table = np.full((len(scenes), len(columns), 6), np.nan)
    valid = np.zeros(table.shape[:2], bool)
    for row, scene in enumerate(scenes):
        there = [columns[thing] for thing in scene]
        table[row, there] = np.reshape(list(scene.values()), (-1, 6))
        valid[row, there] = True
    return Objects(table[..., :2], *(table[..., i] for i in range(2, 6)), valid=valid)


def _road_ends(env: Any) -> bool:
    """Whether the ego's lane ends within half a vehicle and no lane goes on from there."""
    ego = env.vehicle
    return bool(ego.lane.after_end(ego.position)) and not any(continuations(env.road.network, ego.lane_index))
