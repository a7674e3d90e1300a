"""Plain roads: straight, two-way, curve, merge. Each returns a RoadGraph."""

from dataclasses import replace
from typing import Any

import numpy as np

from urbanjax.roadmap.builders.curves import Curve, connect, trace, turn
from urbanjax.roadmap.builders.lanes import assemble
from urbanjax.roadmap.builders.sections import check_sizes, corridor, evenly
from urbanjax.roadmap.builders.specs import LaneSpec, RoadStyle
from urbanjax.roadmap.graph import RoadGraph, RoadType
from urbanjax.types import RoadError

RAMP_SLOPE = 0.1  # m to the side per m along the highway
HIGHWAY_SPEED = 100 / 3.6  # m/s


def straight(
    n_lanes: int = 2,
    length: float = 1000.0,
    *,
    style: RoadStyle = RoadStyle(),  # noqa: B008 (frozen)
) -> RoadGraph:
    """A one-way road along x; the centre of its rightmost lane is y = 0.

    Links: section by section, lanes from left to right. Args: n_lanes; length m; style, of the lanes.
    """
    _check_lanes(n_lanes)
    check_sizes(length=length)
    line = _straight_line(length, (n_lanes - 0.5) * style.lane_width)
    breaks = evenly(length, min(style.section, length))
    lanes = [n_lanes] * (len(breaks) - 1)
    specs = corridor(
        "road", line, breaks=breaks, n_lanes=lanes, lane_width=style.lane_width, speed_limit=style.speed_limit
    )
    return assemble(specs, style.n_points)


def two_way(
    n_lanes: int = 1,
    n_opposite: int = 1,
    *,
    length: float = 1000.0,
    overtaking: bool = True,
    coinciding: bool = False,
    style: RoadStyle = RoadStyle(),  # noqa: B008 (frozen)
) -> RoadGraph:
    """An undivided road along x with lanes in both directions; the centre of the rightmost forward lane is y = 0.

    Links: the forward lanes as in `straight` (areas "forward"), then the others ("backward"). Args: n_lanes,
    n_opposite, lanes each way; length m; overtaking, the oncoming lane may be used for overtaking; coinciding, a
    further forward lane lies on the ground of the first oncoming one, as in highway-env's two-way road; style, of the
    lanes.
    """
    _check_lanes(n_lanes)
    _check_lanes(n_opposite)
    check_sizes(length=length)
    line = _straight_line(length, (n_lanes - 0.5) * style.lane_width)
    ahead = _straight_line(length, (n_lanes + 0.5) * style.lane_width) if coinciding else line
    breaks = evenly(length, min(style.section, length))
    sections = len(breaks) - 1
    common: dict[str, Any] = {"lane_width": style.lane_width, "speed_limit": style.speed_limit}
    forward = corridor(
        "forward", ahead, breaks=breaks, n_lanes=[n_lanes + coinciding] * sections, area="forward", **common
    )
    backward = corridor(
        "backward", line.reversed(), breaks=breaks, n_lanes=[n_opposite] * sections, area="backward", **common
    )
    # Leaving the last lane on the own side, to the left, is what crosses the centre of the road.
    specs = [
        replace(spec, left_change=overtaking) if spec.key[2] == innermost else spec
        for way, innermost in ((forward, int(coinciding)), (backward, 0))
        for spec in way
    ]
    return assemble(specs, style.n_points)


def curve(
    radius: float = 50.0,
    angle: float = np.pi / 2,
    *,
    n_lanes: int = 2,
    lead: float = 60.0,
    transition: float = 15.0,
    style: RoadStyle = RoadStyle(section=60.0),  # noqa: B008 (frozen)
) -> RoadGraph:
    """A curve between two straights of `lead` metres; `radius` is that of the left edge of the road.

    Args: radius m; angle rad, left positive; n_lanes; lead m; transition m, length of the clothoids at both ends of the
    arc; style, of the lanes.
    """
    _check_lanes(n_lanes)
    check_sizes(radius=radius, lead=lead, speed_limit=style.speed_limit)
    if not 0 < abs(angle) < 2 * np.pi:
        raise RoadError(f"angle is {angle}: its size must be between 0 and 2 pi")
    if angle < 0 and radius <= n_lanes * style.lane_width:
        raise RoadError(f"radius {radius} m is less than the width of {n_lanes} lanes on its inner side: raise it")
    bend = turn(angle, radius, transition=transition)
    line = trace([(lead, 0.0, 0.0), *bend, (lead, 0.0, 0.0)])
    straight_part = evenly(lead, min(style.section, lead))
    bend_part = lead + evenly(line.length - 2 * lead, min(style.section, line.length))
    breaks = [*straight_part, *bend_part[1:], *(bend_part[-1] + straight_part[1:])]
    first = len(straight_part) - 1
    areas = {first + k: {"area": "curve"} for k in range(len(bend_part) - 1)}
    lanes = [n_lanes] * (len(breaks) - 1)
    specs = corridor(
        "road",
        line,
        breaks=breaks,
        n_lanes=lanes,
        lane_width=style.lane_width,
        sections=areas,
        speed_limit=style.speed_limit,
    )
    return assemble(specs, style.n_points)


def merge(
    n_lanes: int = 2,
    before: float = 150.0,
    *,
    parallel: float = 100.0,
    after: float = 250.0,
    ramp: float = 120.0,
    style: RoadStyle = RoadStyle(speed_limit=HIGHWAY_SPEED),  # noqa: B008 (frozen)
) -> RoadGraph:
    """A highway along x with an on-ramp from the right, whose lane runs beside the others and then ends.

    Links: three sections of the highway, its lanes from left to right (the middle section has one more, the
    acceleration lane, without successor), then the ramp. The centre of the rightmost through lane is y = 0.
    Args: n_lanes; before, parallel, after m, section lengths; ramp m, extent of the ramp along x; style, of the lanes.
    """
    _check_lanes(n_lanes)
    check_sizes(before=before, parallel=parallel, after=after, ramp=ramp)
    lane_width, speed_limit = style.lane_width, style.speed_limit
    line = _straight_line(before + parallel + after, (n_lanes - 0.5) * lane_width)
    breaks = [0.0, before, before + parallel, before + parallel + after]
    specs = corridor(
        "road",
        line,
        breaks=breaks,
        n_lanes=[n_lanes, n_lanes + 1, n_lanes],
        lane_width=lane_width,
        sections={1: {"area": "merge"}},
        speed_limit=speed_limit,
        road_type=RoadType.HIGHWAY,
    )
    way = connect((before - ramp, -lane_width - RAMP_SLOPE * ramp, 0.0), (before, -lane_width, 0.0))
    specs.append(
        LaneSpec(
            "ramp",
            way.position,
            way.heading,
            lane_width,
            speed_limit=speed_limit,
            road_type=RoadType.RAMP,
            area="ramp",
            successors=(("road", 1, n_lanes),),
        )
    )
    return assemble(specs, style.n_points)


def _straight_line(length: float, y: float) -> Curve:
    return trace([(length, 0.0, 0.0)], (0.0, y, 0.0), step=length / 8)


def _check_lanes(n: int) -> None:
    if n < 1:
        raise RoadError(f"number of lanes is {n}: use 1 or more")
