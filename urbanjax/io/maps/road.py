"""What a map file states, in records that all formats share (host side, float64)."""

import dataclasses
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import numpy as np

from urbanjax.evaluation.recorded.planning_problem import PlanningProblem
from urbanjax.io.maps.xml import MapError
from urbanjax.roadmap.graph import RoadGraph, RoadType, Rule, Turn
from urbanjax.sim.signals import SignalCycle
from urbanjax.types import host_record


@host_record
class MapLane:
    """One lane as a map states it; None where the map is silent."""

    id: Hashable
    left: np.ndarray  # [m, 2] m, left border in driving direction, map coordinates
    right: np.ndarray  # [k, 2] m
    successors: tuple[Hashable, ...] = ()
    predecessors: tuple[Hashable, ...] | None = None
    left_id: Hashable | None = None  # neighbour in the same direction
    left_change: bool | None = None  # permission to cross the left border
    right_id: Hashable | None = None
    right_change: bool | None = None
    opposite_id: Hashable | None = None  # neighbour in the other direction
    speed_limit: float | None = None  # m/s
    turn: Turn | None = None
    road_type: RoadType | None = None
    rule: Rule = Rule.NONE  # at its end
    entry_rule: Rule = Rule.NONE  # at its start
    signals: tuple[tuple[Hashable, np.ndarray | None], ...] = ()  # id and a point [2] of the stop line, or its end
    paired: bool = False  # the points of both borders lie beside each other
    drawn: bool = True  # the borders are the map's own, not made from a centre line
    area: str = ""


@host_record
class MapFault:
    """Something in a map that was left out or looks wrong."""

    kind: str
    lane: Hashable
    detail: str = ""


@host_record
class RoadMap:
    """A map file as read: the road graph, and what its links and signals are called in the file."""

    graph: RoadGraph
    ids: tuple[Hashable, ...]  # lane of each link
    format: str
    path: Path
    lanes: tuple[MapLane, ...]  # as stated, with those that became no link
    faults: tuple[MapFault, ...] = ()  # what was left out on the way to the graph
    signal_ids: tuple[Any, ...] = ()  # signal of each of the graph's signal numbers
    cycles: tuple[SignalCycle | None, ...] = ()  # of each signal, None where the map has none
    recording: Any = None  # a `Recording`, None where the map carries no traffic
    problems: tuple[PlanningProblem, ...] = ()
    geo: tuple[float, float] | None = None  # deg, latitude and longitude of map coordinates (0, 0), where projected
    other: dict[str, int] = dataclasses.field(default_factory=dict)  # counts of what the graph has no place for

    def link(self, lane: Hashable) -> int:
        """Number of the link of a lane. Raises MapError for a lane that is none."""
        if lane not in self.ids:
            raise MapError(f"{self.path}: lane {lane!r} is no link of the map's graph")
        return self.ids.index(lane)
