"""Intersections of roads (host side)."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from urbanjax.roadmap.builders.curves import connect, trace
from urbanjax.roadmap.builders.lanes import assemble
from urbanjax.roadmap.builders.sections import check_sizes, corridor
from urbanjax.roadmap.builders.specs import LaneSpec
from urbanjax.roadmap.graph import RoadGraph, RoadType, Rule, Turn
from urbanjax.types import RoadError

ROOM = 8.0  # m, for turns between the road's edge and the ends of the legs
SETBACK = 1.0  # m, of a stop line from the end of its link
LEGS = ("west", "south", "east", "north")  # where the four approaches come from, counter-clockwise


def intersection(
    signalised: bool = True,
    n_lanes: int = 2,
    *,
    leg: float = 100.0,
    size: float = 0.0,
    lane_width: float = 3.5,
    speed_limit: float = 50 / 3.6,
    n_points: int = 32,
) -> RoadGraph:
    """A four-leg intersection at the origin, with `n_lanes` lanes in and out on each leg (right-hand traffic).

    Links: the approaches from west, south, east and north (areas "west in" ..), lanes from left to right, then the
    exits ("west out" ..), then the turns ("west left", "west straight", "west right" ..). The leftmost lane turns
    left, the rightmost right, all go straight. With signals, approach k (in the order above) has signal k; without,
    the north-south road yields.
    Args: signalised, whether there are signals; n_lanes, each way; leg m, length of each leg; size m, half of the open
    square (0: as needed); lane_width m; speed_limit m/s; n_points, per link.
    """
    if n_lanes < 1:
        raise RoadError(f"n_lanes is {n_lanes}: use 1 or more")
    check_sizes(leg=leg, lane_width=lane_width, speed_limit=speed_limit)
    half = size or n_lanes * lane_width + ROOM
    if half <= n_lanes * lane_width:
        raise RoadError(f"size {size} m is within the road's own {n_lanes * lane_width} m: raise it")
    common: dict[str, Any] = {"lane_width": lane_width, "speed_limit": speed_limit}
    ways_in, ways_out = [], []
    for k, name in enumerate(LEGS):
        angle = 0.5 * np.pi * k
        away = np.array([np.cos(angle), np.sin(angle)])
        inward = trace([(leg, 0.0, 0.0)], (*(-(half + leg) * away), angle), step=leg / 8)
        control = {"signals": ((k, leg - SETBACK),)} if signalised else {"rule": Rule.YIELD if k % 2 else Rule.NONE}
        ways_in += corridor(
            f"{name} in", inward, breaks=[0.0, leg], n_lanes=[n_lanes], area=f"{name} in", **control, **common
        )
        ways_out += corridor(
            f"{name} out", inward.reversed(), breaks=[0.0, leg], n_lanes=[n_lanes], area=f"{name} out", **common
        )
    specs = [*ways_in, *ways_out]
    for k, name in enumerate(LEGS):
        for kind, step, lanes in (
            (Turn.LEFT, 3, [0]),
            (Turn.STRAIGHT, 2, range(n_lanes)),
            (Turn.RIGHT, 1, [n_lanes - 1]),
        ):
            target = f"{LEGS[(k + step) % 4]} out"
            pairs = [((f"{name} in", 0, q), (target, 0, q)) for q in lanes]
            specs = join(
                specs, pairs, area=f"{name} {kind.name.lower()}", turn=kind, width=lane_width, speed_limit=speed_limit
            )
    return assemble(specs, n_points)


def join(specs: Sequence[LaneSpec], pairs: Sequence[tuple[Any, Any]], *, area: str, **fields: Any) -> list[LaneSpec]:
    """`specs` with a junction link from the end of each pair's first lane to the start of its second.

    Keys of the new links are (area, first key, second key). Links of neighbouring lanes are neighbours, without
    permission to change.
    Args: specs, lanes; pairs, keys of two of them; area of the new links; fields, LaneSpec fields of all of them.
    """
    by_key = {spec.key: spec for spec in specs}
    keys = {start: (area, start, end) for start, end in pairs}
    for start, end in pairs:
        a, b = by_key[start], by_key[end]
        assert a.heading is not None
        assert b.heading is not None
        way = connect((*a.centre[-1], a.heading[-1]), (*b.centre[0], b.heading[0]))
        link = LaneSpec(
            keys[start],
            way.position,
            way.heading,
            road_type=RoadType.JUNCTION,
            area=area,
            successors=(end,),
            left=keys.get(a.left),
            right=keys.get(a.right),
            left_change=False,
            right_change=False,
            **fields,
        )
        by_key[start] = replace(a, successors=(*a.successors, link.key))
        by_key[link.key] = link
    return list(by_key.values())
