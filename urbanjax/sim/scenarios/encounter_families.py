"""The families of encounters by name: the road of each, and who is on it (host side)."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from urbanjax.roadmap.builders import intersection, straight
from urbanjax.roadmap.builders.specs import RoadStyle
from urbanjax.roadmap.padding import GraphSize
from urbanjax.sim.agents import TrafficParams
from urbanjax.sim.scenarios import encounters
from urbanjax.sim.scenarios.drawn_roads import DrawnRoad
from urbanjax.sim.scenarios.encounters import BrakingLeader, Crossing, CutIn, Encounter, EncounterPlace
from urbanjax.sim.scenarios.stage import Cast, Stage, StageSize, stage
from urbanjax.sim.world import WorldState
from urbanjax.types import host_record
from urbanjax.vehicle.params import VehicleParams

LIMIT = 50 / 3.6  # m/s, where all of them take place
LENGTH = 400.0  # m, of a straight road
LEG = 200.0  # m, of the junction: whoever comes fastest and last begins on it
START = 60.0  # m, station of the ego's rear axle on a straight road
BEFORE = 25.0  # m, from the ego's front bumper to the junction's edge
DURATION = 6.0  # s, of any encounter, so that all of them share a program
SIZE = dataclasses.replace(
    StageSize(),
    graph=GraphSize(n_links=24, n_successors=3, n_relations=9, n_signals_per_link=1),
    n_signals=1,
    n_stations=512,
    n_vehicles=1,
)


@host_record
class Family:
    """One kind of encounter."""

    name: str
    numbers: Any  # the params class's default: where searches begin
    road: Callable[[], DrawnRoad]
    other: Callable[[Cast], EncounterPlace]  # puts ego and other on the road, anywhere
    encounter: Callable[[Any, EncounterPlace], Encounter]  # pure
    duration: float  # s
    plane: tuple[str, str]  # the two numbers that say most of it


@host_record
class EncounterStage:
    """A family's road with both on it."""

    stage: Stage
    world: WorldState
    place: EncounterPlace
    start: float  # m, station of the ego's rear axle on its route


@functools.lru_cache(maxsize=8)
def _stage(name: str) -> Stage:
    road = FAMILIES[name].road()
    return stage(road.graph, road.start, goal=road.goal, size=SIZE)


def staged(family: Family, *, others: TrafficParams, vehicle: VehicleParams) -> EncounterStage:
    """The family's stage. Args: family; others, how traffic drives; vehicle, the ego's dimensions."""
    cast = Cast(_stage(family.name), others, vehicle=vehicle)
    place = family.other(cast)
    return EncounterStage(cast.stage, cast.world(), place, cast.start)


def _lanes(count: int) -> DrawnRoad:
    graph = straight(count, LENGTH, style=RoadStyle(speed_limit=LIMIT))
    return DrawnRoad(graph, count - 1, count - 1, LIMIT)


def _junction() -> DrawnRoad:
    """The ego comes from the south, where one yields, and goes straight on to the north."""
    return DrawnRoad(intersection(False, 1, leg=LEG, speed_limit=LIMIT), 1, 4 + 3, LIMIT)


def _ahead(cast: Cast) -> EncounterPlace:
    cast.add_ego(START, speed=0.0)
    cast.add(cast.front + 20.0, speed=0.0, reacts=False)
    return EncounterPlace(LIMIT, cast.front, cast.half)


def _beside(cast: Cast) -> EncounterPlace:
    cast.add_ego(START, speed=0.0)
    at = cast.front + 20.0
    link, along = cast.stage.place(at, 1)
    cast.add(at, speed=0.0, reacts=False, other=link, other_station=along, has_other=True)
    return EncounterPlace(LIMIT, cast.front, cast.half, aside=cast.stage.offset(at, 1) - cast.stage.offset(at, 0))


def _from_the_left(cast: Cast) -> EncounterPlace:
    """The other comes from the west: its link is 0, and both ways are straight."""
    graph = cast.stage.graph
    length = float(graph.length[0])
    start = length - BEFORE - (float(cast.vehicle.length) - float(cast.vehicle.rear_overhang))
    cast.add_ego(start, speed=0.0)
    cast.add_on(0, length / 2, speed=0.0, reacts=False, route=_straight_on(cast.stage))
    begin, end = cast.stage.on(0, 0.0), cast.stage.on(0, length)
    towards = (end - begin) / np.linalg.norm(end - begin)
    ego, heading = cast.stage.point(cast.front)
    across = np.array([np.cos(heading), np.sin(heading)])
    # Straight ways: ego + way * across = begin + crossing * towards.
    way, station = np.linalg.solve(np.stack([across, -towards], axis=1), begin - ego)
    return EncounterPlace(LIMIT, 0.0, cast.half, way=float(way), crossing=float(station))


def _straight_on(where: Stage) -> int:
    """Which of the successors of link 0 leads straight on."""
    graph = where.graph
    heading = [np.diff(np.asarray(graph.centre[link])[[0, -1]], axis=0)[0] for link in range(len(graph.length))]
    own = heading[0] / np.linalg.norm(heading[0])
    following = np.asarray(where.lanes.successor[0])[: int(where.lanes.n_successors[0])]
    along = [heading[link] @ own / max(float(np.linalg.norm(heading[link])), 1e-6) for link in following]
    return int(np.argmax(along))


FAMILIES = {
    family.name: family
    for family in (
        Family(
            "braking_leader",
            BrakingLeader(),
            functools.partial(_lanes, 1),
            _ahead,
            encounters.braking_leader,
            DURATION,
            ("time_gap", "braking"),
        ),
        Family(
            "cut_in",
            CutIn(),
            functools.partial(_lanes, 2),
            _beside,
            encounters.cut_in,
            DURATION,
            ("time_gap", "other_speed"),
        ),
        Family(
            "crossing",
            Crossing(),
            _junction,
            _from_the_left,
            encounters.crossing,
            DURATION,
            ("later", "other_speed"),
        ),
    )
}
