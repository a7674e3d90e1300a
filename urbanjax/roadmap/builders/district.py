"""A closed urban course with the areas of the paper's Fig. 11 (host side)."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from urbanjax.roadmap.builders.curves import Curve, Piece, trace, turn
from urbanjax.roadmap.builders.junctions import join
from urbanjax.roadmap.builders.lanes import assemble
from urbanjax.roadmap.builders.sections import corridor, evenly
from urbanjax.roadmap.builders.specs import LaneSpec
from urbanjax.roadmap.graph import RoadGraph, RoadType, Turn

LEG = 100.0  # m, length of the legs that cross the course at intersection C
SETBACK = 2.0  # m, of a stop line from the end of its link
TRANSITION, SHORT_TRANSITION = 20.0, 8.0  # m, clothoids of curves, and of the turn at intersection C
STRAIGHT, CURVE = 90.0, 60.0  # m, largest length of a link


@dataclass(frozen=True)
class _Element:
    """One straight or curve of the course."""

    area: str
    length: float = 0.0  # m, of a straight (0 for a curve)
    angle: float = 0.0  # degrees, left positive
    radius: float = 0.0  # m, of the left edge of the road
    lanes: tuple[int, ...] = (2,)  # numbers of lanes, spread evenly over the element's links
    signals: tuple[float, ...] = ()  # signals at the ends of the links nearest to these fractions of the element

    def pieces(self) -> list[Piece]:
        if self.length:
            return [(self.length, 0.0, 0.0)]
        transition = SHORT_TRANSITION if self.area == "intersection C" else TRANSITION
        return turn(np.radians(self.angle), self.radius, transition=transition)


# In driving direction. The two lengths of 1 m are solved for, so that the course closes.
COURSE = (
    _Element("", 280.0, lanes=(3,), signals=(0.6,)),
    _Element("curve A", angle=90.0, radius=55.0, lanes=(3,)),
    _Element("", 430.0, lanes=(3, 3, 2, 2, 2), signals=(0.4,)),
    _Element("curve B", angle=-60.0, radius=60.0, lanes=(2,)),
    _Element("", 360.0, lanes=(2, 2, 3, 3), signals=(1.0,)),
    _Element("intersection C", angle=90.0, radius=24.0, lanes=(2,)),
    _Element("", 360.0, lanes=(3, 3, 2, 2)),
    _Element("curve D", angle=60.0, radius=70.0, lanes=(2,)),
    _Element("", 460.0, lanes=(2, 2, 3, 3, 3), signals=(0.5,)),
    _Element("curve E", angle=-45.0, radius=80.0, lanes=(3,)),
    _Element("straight H", 620.0, lanes=(3, 4, 4, 4, 4, 4, 3), signals=(0.6,)),
    _Element("curve F", angle=135.0, radius=45.0, lanes=(3,)),
    _Element("straight I", 1.0, lanes=(3, 3, 3, 2, 2, 2), signals=(0.35, 0.8)),
    _Element("curve G", angle=90.0, radius=50.0, lanes=(2,)),
    _Element("", 1.0, lanes=(2, 2, 3, 3), signals=(0.5,)),
)


def district(lane_width: float = 3.5, speed_limit: float = 50 / 3.6, *, n_points: int = 32) -> RoadGraph:
    """A closed course of about 5 km, driven counter-clockwise, with two to four lanes and signals.

    Areas "curve A", "curve B", "intersection C", "curve D" .. "curve G", "straight H", "straight I" and unnamed rest;
    the roads that cross at C are in area "cross". Link 0 is the leftmost lane at the start of the course, and
    `predecessor[0, 0]` the link that closes it; further links follow section by section, lanes from left to right.
    Lanes that the course drops end without a successor beside a lane that goes on. At C the course turns left under a
    signal, and traffic crosses from all sides. Signal ids follow the course; the last two are those of the crossing
    roads.
    Args: lane_width m; speed_limit m/s, of all lanes; n_points, per link.
    """
    elements = _closed(COURSE)
    line = trace([piece for element in elements for piece in element.pieces()])
    breaks, lanes, sections = [0.0], [], {}
    n_signals = corner = 0
    for element in elements:
        length = sum(piece[0] for piece in element.pieces())
        n = len(evenly(length, STRAIGHT if element.length else CURVE)) - 1
        governed = [round(f * n) - 1 for f in element.signals]
        for k in range(n):
            fields: dict[str, Any] = {"area": element.area}
            if element.area == "intersection C":
                corner = len(lanes)
                fields |= {
                    "turn": Turn.LEFT,
                    "road_type": RoadType.JUNCTION,
                    "left_change": False,
                    "right_change": False,
                }
            if k in governed:
                fields["signals"] = ((n_signals, length / n - SETBACK),)
            sections[len(lanes)] = fields
            lanes.append(element.lanes[k * len(element.lanes) // n])
            breaks.append(breaks[-1] + length / n)
            n_signals += k in governed
    for k in (corner - 1, corner + 1):
        sections[k]["area"] = "intersection C"
    breaks[-1] = line.length
    common: dict[str, Any] = {"lane_width": lane_width, "speed_limit": speed_limit}
    specs = corridor("course", line, breaks=breaks, n_lanes=lanes, closed=True, sections=sections, **common)
    specs = _cross(specs, line, breaks, corner, n_signals, common)
    return assemble(specs, n_points)


def _closed(course: tuple[_Element, ...]) -> list[_Element]:
    """The course with its two free lengths (1 m in the table) such that it ends where it starts."""

    def end(free: list[float]) -> np.ndarray:
        lengths = iter(free)
        pieces = [
            piece
            for element in course
            for piece in (replace(element, length=next(lengths)) if element.length == 1.0 else element).pieces()
        ]
        return np.array(trace(pieces).end()[:2])

    base = end([1.0, 1.0])
    slope = np.stack([end([2.0, 1.0]) - base, end([1.0, 2.0]) - base], -1)
    free = iter(1.0 + np.linalg.solve(slope, -base))
    return [replace(element, length=float(next(free))) if element.length == 1.0 else element for element in course]


def _cross(
    specs: list[LaneSpec], line: Curve, breaks: list[float], corner: int, n_signals: int, common: dict[str, Any]
) -> list[LaneSpec]:
    """The course with the roads that cross it at C: legs to the east and south, and the other sides of the course."""
    start, end = line.at(np.array([breaks[corner]])), line.at(np.array([breaks[corner + 1]]))
    ahead = np.array([np.cos(start.heading[0]), np.sin(start.heading[0])])
    aside = np.array([np.cos(end.heading[0]), np.sin(end.heading[0])])
    reach = float((end.position[0] - start.position[0]) @ ahead)
    middle = start.position[0] + reach * ahead
    east = trace([(LEG, 0.0, 0.0)], (*(middle + reach * ahead), start.heading[0]))
    south = trace([(LEG, 0.0, 0.0)], (*(middle - (reach + LEG) * aside), end.heading[0]))
    west = line.cut(breaks[corner] - LEG, breaks[corner]).reversed()
    north = line.cut(breaks[corner + 1], breaks[corner + 1] + LEG).reversed()

    def leg(name: str, way: Curve, n: int, signal: int | None = None) -> list[LaneSpec]:
        fields = {} if signal is None else {"signals": ((n_signals + signal, LEG - SETBACK),)}
        return corridor(name, way, breaks=[0.0, way.length], n_lanes=[n], area="cross", **fields, **common)

    specs = [
        *specs,
        *leg("east in", east.reversed(), 2, 0),
        *leg("east out", east, 1),
        *leg("south in", south, 1, 1),
        *leg("south out", south.reversed(), 1),
        *leg("north in", north, 1, 1),
        *leg("west out", west, 1),
    ]
    course_in, course_out = (lambda q: ("course", corner - 1, q)), (lambda q: ("course", corner + 1, q))
    east_out, south_out, west_out = ("east out", 0, 0), ("south out", 0, 0), ("west out", 0, 0)
    for kind, pairs in (
        (Turn.STRAIGHT, [(course_in(2), east_out), (("east in", 0, 0), west_out)]),
        (Turn.STRAIGHT, [(("south in", 0, 0), course_out(1)), (("north in", 0, 0), south_out)]),
        (Turn.LEFT, [(("north in", 0, 0), east_out)]),
        (Turn.LEFT, [(("east in", 0, 0), south_out)]),
        (Turn.RIGHT, [(course_in(2), south_out), (("east in", 0, 1), course_out(2))]),
        (Turn.RIGHT, [(("south in", 0, 0), east_out)]),
    ):
        fields = {"width": common["lane_width"], "speed_limit": common["speed_limit"]}
        specs = join(specs, pairs, area="intersection C", turn=kind, **fields)
    return specs
