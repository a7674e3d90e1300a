"""A kind of drive of which there are as many as there are seeds (host side)."""

import functools
from collections.abc import Callable

import jax
import numpy as np

from urbanjax.evaluation.case import Case
from urbanjax.sim.agents import TrafficParams
from urbanjax.sim.scenarios.drawn_roads import DrawnRoad
from urbanjax.sim.scenarios.stage import Cast, Stage, StageSize, stage
from urbanjax.types import as_arrays, host_record
from urbanjax.vehicle.params import VehicleParams

ROADS = 16  # that a mission draws; seed after seed takes the next one
LONGEST = 30.0  # s, of any drive of a mission, where nothing shorter is asked
BEYOND = 10.0  # m, behind the last junction
SLACK = 4.0  # s, on top of the time that the pace of a mission gives


@host_record
class Mission:
    """Where, among whom, how far and within which time. Success is told by `scores.competition`."""

    name: str
    number: int  # of the generator's seed: missions draw independently
    road: Callable[[np.random.Generator], DrawnRoad]
    cast: Callable[[np.random.Generator, Cast], None]
    way: float | None  # m, from the start to the goal; None: to `BEYOND` the last junction
    pace: float  # of the speed limit, that the time limit asks for
    size: StageSize = StageSize()
    longest: float = LONGEST  # s, of its logs: after that a drive ends

    def limit(self, way: float, speed_limit: float) -> float:
        """Time [s] in which the goal is to be reached. Args: way m, to it; speed_limit m/s."""
        return min(way / (self.pace * speed_limit) + SLACK, self.longest)

    def case(self, seed: int, *, others: TrafficParams, vehicle: VehicleParams) -> Case:
        """The drive of a seed: the same for every driver, and whatever else is drawn.

        Args: seed; others, how traffic drives; vehicle, the ego's dimensions.
        """
        where, speed_limit = _stage(self, seed % ROADS)
        cast = Cast(where, others, vehicle=vehicle)
        self.cast(np.random.default_rng([self.number, seed, 1]), cast)
        start = cast.start + float(vehicle.centre_offset)
        way = where.beyond_junctions() + BEYOND - start if self.way is None else self.way
        numbers = as_arrays({"goal": start + way, "limit": self.limit(way, speed_limit)})
        return Case(where.corridor, where.lanes, cast.world(), **jax.device_get(numbers))


@functools.lru_cache(maxsize=512)
def _stage(mission: Mission, which: int) -> tuple[Stage, float]:
    """One of the roads of a mission, made once."""
    road = mission.road(np.random.default_rng([mission.number, which, 0]))
    return stage(road.graph, road.start, goal=road.goal, size=mission.size), road.speed_limit
