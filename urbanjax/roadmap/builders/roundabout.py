"""A roundabout (host side)."""

from dataclasses import replace

import numpy as np

from urbanjax.roadmap.builders.curves import connect, trace
from urbanjax.roadmap.builders.junctions import LEGS
from urbanjax.roadmap.builders.lanes import assemble
from urbanjax.roadmap.builders.sections import check_sizes
from urbanjax.roadmap.builders.specs import LaneSpec, RoadStyle
from urbanjax.roadmap.graph import RoadGraph, RoadType, Rule, Turn
from urbanjax.types import RoadError

APART = np.radians(28.0)  # between the direction of a leg and where it meets the ring, on either side
APPROACH = 14.0  # m, from the ring's centre line to the end of a leg
LEAST = 8.0  # m, radius, below which entry and exit of a leg do not fit


def roundabout(
    radius: float = 18.0,
    *,
    leg: float = 100.0,
    style: RoadStyle = RoadStyle(),  # noqa: B008 (frozen)
) -> RoadGraph:
    """A ring of one lane around the origin, driven counter-clockwise, with four legs of one lane each way.

    Who drives in the ring has priority. Links: the approaches from west, south, east and north (areas "west in" ..),
    the exits ("west out" ..), then of each leg the way into the ring, the way out of it, the arc from its entry to the
    next leg's exit and the arc from its exit to its entry (areas "west enters", "west leaves", "ring").
    Args: radius m, of the ring's centre line; leg m, length of each leg; style, of the lanes. Raises RoadError for a
    ring that is too small.
    """
    check_sizes(radius=radius, leg=leg, lane_width=style.lane_width, speed_limit=style.speed_limit)
    if radius < max(LEAST, 2 * style.lane_width):
        raise RoadError(f"radius is {radius} m: a ring needs {max(LEAST, 2 * style.lane_width):g} m or more")
    common = LaneSpec("", np.zeros((2, 2)), width=style.lane_width, speed_limit=style.speed_limit)
    ways_in, ways_out, ring = [], [], []
    for k, name in enumerate(LEGS):
        direction = np.pi + 0.5 * np.pi * k  # from the centre outwards
        following = LEGS[(k + 1) % len(LEGS)]
        away = np.array([np.cos(direction), np.sin(direction)])
        aside = 0.5 * style.lane_width * np.array([-away[1], away[0]])
        near = (radius + APPROACH) * away
        inward = trace([(leg, 0.0, 0.0)], (*(near + leg * away + aside), direction + np.pi), step=leg / 8)
        outward = trace([(leg, 0.0, 0.0)], (*(near - aside), direction), step=leg / 8)
        entry, leaving = (_on_ring(radius, direction + side * APART) for side in (1, -1))
        parts = {
            (name, "in"): (inward, ((name, "enters"),)),
            (name, "out"): (outward, ()),
            (name, "enters"): (connect(inward.end(), entry), ((name, "arc"),)),
            (name, "leaves"): (connect(leaving, (*(near - aside), direction)), ((name, "out"),)),
            (name, "arc"): (
                trace([(radius * (0.5 * np.pi - 2 * APART), 1 / radius, 1 / radius)], entry),
                ((following, "between"), (following, "leaves")),
            ),
            (name, "between"): (
                trace([(radius * 2 * APART, 1 / radius, 1 / radius)], leaving),
                ((name, "arc"),),
            ),
        }
        specs = {
            key: replace(common, key=key, centre=way.position, heading=way.heading, successors=successors)
            for key, (way, successors) in parts.items()
        }
        ways_in.append(replace(specs[name, "in"], area=f"{name} in", rule=Rule.YIELD))
        ways_out.append(replace(specs[name, "out"], area=f"{name} out"))
        for part in ("enters", "leaves", "arc", "between"):
            round_it = part in ("arc", "between")
            turn, area = (Turn.STRAIGHT, "ring") if round_it else (Turn.RIGHT, f"{name} {part}")
            ring.append(replace(specs[name, part], area=area, turn=turn, road_type=RoadType.JUNCTION))
    return assemble([*ways_in, *ways_out, *ring], style.n_points)


def _on_ring(radius: float, angle: float) -> tuple[float, float, float]:
    """The pose of somebody in the ring at an angle."""
    return radius * float(np.cos(angle)), radius * float(np.sin(angle)), float(angle + 0.5 * np.pi)
