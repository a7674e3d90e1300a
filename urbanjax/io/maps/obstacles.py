"""The moving part of a CommonRoad file: obstacles with their recorded trajectories, and planning problems."""

from typing import Any

import numpy as np

from urbanjax.evaluation.recorded.planning_problem import Goal, PlanningProblem, Region
from urbanjax.io.maps.road import RoadMap
from urbanjax.io.maps.xml import Element, Xml
from urbanjax.sim.recording import RecordedTrack, Recording, record

MOST_STATES = 5_000_000  # road users times time steps
LONGEST = 1e6  # time steps
SPEEDS = 500.0  # m/s
ANGLES = 1e3  # rad
SIZES, WIDEST = (1e-3, 1e3), 1e5  # m, of road users; of regions at most
OBSTACLES = ("obstacle", "dynamicObstacle", "staticObstacle")


def recording(xml: Xml, dt: float, *, found: RoadMap) -> Recording | None:
    """The obstacles of a file, relative to the graph's origin; None where it has none.

    Args: xml, the parsed file; dt [s], a time step; found, the map.
    """
    elements = [e for tag in OBSTACLES for e in xml.root.findall(tag)]
    if not elements:
        return None
    seen: set[int] = set()
    tracks = []
    for element in elements:
        tracks.append(_track(xml, element))
        if tracks[-1].id in seen:
            raise xml.fail(element, "the id occurs twice")
        seen.add(tracks[-1].id)
    if len(tracks) * (1 + max(int(track.step[-1]) for track in tracks)) > MOST_STATES:
        late = elements[int(np.argmax([track.step[-1] for track in tracks]))]
        raise xml.fail(late, f"its last time step makes a recording of more than {MOST_STATES} states")
    return record(tracks, dt, origin=found.graph.origin)


def _track(xml: Xml, element: Element) -> RecordedTrack:
    """One obstacle; states beyond the first come from its trajectory."""
    standing = element.tag == "staticObstacle" or element.findtext("role", "").strip() == "static"
    states = [xml.child(element, "initialState"), *([] if standing else element.findall("trajectory/state"))]
    rows = np.array([_state(xml, element, state) for state in states])
    if np.any(np.diff(rows[:, 0]) <= 0):
        raise xml.fail(element, "the time steps of its states do not rise")
    length, width = _shape(xml, element)
    step, x, y, heading, speed = rows.T
    if standing:
        step = np.zeros(1)
    kind = xml.text(element, "type")
    position = np.stack([x, y], -1)
    return RecordedTrack(xml.id(element), kind, length, width, step.astype(int), position, heading, speed, standing)


def _state(xml: Xml, owner: Element, state: Element) -> tuple[float, float, float, float, float]:
    """Time step, x, y [m], heading [rad] and speed [m/s] of a state; a speed that is not given is 0."""
    step = _middle(xml, owner, state, "time", 0.0, LONGEST)
    (x, y) = _place(xml, owner, xml.child(state, "position"))
    speed = 0.0 if state.find("velocity") is None else _middle(xml, owner, state, "velocity", -SPEEDS, SPEEDS)
    return float(round(step)), x, y, _middle(xml, owner, state, "orientation", -ANGLES, ANGLES), speed


def _place(xml: Xml, owner: Element, position: Element) -> tuple[float, float]:
    """A point, or the middle of the shape that a position may lie in."""
    tags = ("point", "rectangle/center", "circle/center", "polygon/point")
    point = next((found for found in (position.find(tag) for tag in tags) if found is not None), None)
    if point is None:
        raise xml.fail(owner, "a state has a position without a point")
    x, y = (xml.number(owner, xml.text(point, axis, owner), axis) for axis in "xy")
    return x, y


def _interval(xml: Xml, owner: Element, value: Element, low: float, high: float) -> tuple[float, float]:
    """Both ends of an interval; an exact value is both."""
    exact = value.find("exact")
    if exact is not None:
        number = xml.number(owner, exact.text or "", value.tag, low, high)
        return number, number
    start, end = (
        xml.number(owner, xml.text(value, tag, owner), value.tag, low, high) for tag in ("intervalStart", "intervalEnd")
    )
    if end < start:
        raise xml.fail(owner, f"the interval of {value.tag} ends before it starts")
    return start, end


def _middle(xml: Xml, owner: Element, state: Element, tag: str, low: float, high: float) -> float:
    value = state.find(tag)
    if value is None:
        raise xml.fail(owner, f"a state has no <{tag}>")
    return 0.5 * sum(_interval(xml, owner, value, low, high))


def _shape(xml: Xml, element: Element) -> tuple[float, float]:
    """Length and width [m] of a rectangle, circle or polygon."""
    shape = xml.child(element, "shape")
    rectangle, circle, polygon = (shape.find(tag) for tag in ("rectangle", "circle", "polygon"))
    if rectangle is not None:
        length, width = (
            xml.number(element, xml.text(rectangle, tag, element), tag, *SIZES) for tag in ("length", "width")
        )
        return length, width
    if circle is not None:
        radius = xml.number(element, xml.text(circle, "radius", element), "radius", *SIZES)
        return 2 * radius, 2 * radius
    points = _polygon(xml, element, polygon) if polygon is not None else np.zeros((0, 2))
    if len(points) < 3:
        raise xml.fail(element, "its shape is no rectangle, circle or polygon")
    length, width = np.maximum(np.ptp(points, axis=0), SIZES[0])
    return float(length), float(width)


def _polygon(xml: Xml, owner: Element, polygon: Element) -> np.ndarray:
    return xml.points(owner, [(p.findtext("x"), p.findtext("y")) for p in polygon.findall("point")], "polygon")


def planning_problems(xml: Xml, dt: float, *, found: RoadMap) -> tuple[PlanningProblem, ...]:
    """The planning problems of a file, relative to the graph's origin; times in seconds.

    Args: xml, the parsed file; dt [s], a time step; found, the map.
    """
    out = []
    for element in xml.root.findall("planningProblem"):
        step, x, y, heading, speed = _state(xml, element, xml.child(element, "initialState"))
        goals = tuple(_goal(xml, element, state, dt, found) for state in element.findall("goalState"))
        at = (x - found.graph.origin[0], y - found.graph.origin[1])
        out.append(PlanningProblem(xml.id(element), at, heading, speed, step * dt, goals))
    return tuple(out)


def _goal(xml: Xml, owner: Element, state: Element, dt: float, found: RoadMap) -> Goal:
    """One goal state."""

    def interval(tag: str, high: float, scale: float = 1.0) -> tuple[float, float] | None:
        value = state.find(tag)
        ends = None if value is None else _interval(xml, owner, value, -high, high)
        return None if ends is None else (ends[0] * scale, ends[1] * scale)

    lanes = tuple(xml.id(lanelet, "ref") for lanelet in state.iterfind("position/lanelet"))
    missing = [lane for lane in lanes if lane not in {stated.id for stated in found.lanes}]
    if missing:
        raise xml.fail(owner, f"its goal is the lanelet {missing[0]}, which is missing")
    position = state.find("position")
    return Goal(
        lanes=lanes,
        links=tuple(found.ids.index(lane) for lane in lanes if lane in found.ids),
        regions=() if position is None else tuple(_regions(xml, owner, position, found.graph.origin)),
        time=interval("time", LONGEST, dt),
        speed=interval("velocity", SPEEDS),
        heading=interval("orientation", ANGLES),
    )


def _regions(xml: Xml, owner: Element, position: Element, origin: tuple[float, float]) -> list[Region]:
    """Boxes, discs, polygons and points of a goal's position."""
    out = []
    for shape in position:
        if shape.tag in ("rectangle", "circle"):
            centre = shape.find("center")
            x, y = (0.0 if centre is None else xml.number(owner, xml.text(centre, axis, owner), axis) for axis in "xy")
            sizes = {"rectangle": ("length", "width"), "circle": ("radius",)}[shape.tag]
            size: dict[str, Any] = {
                key: xml.number(owner, xml.text(shape, key, owner), key, SIZES[0], WIDEST) for key in sizes
            }
            heading = xml.number(owner, shape.findtext("orientation", "0"), "orientation", -ANGLES, ANGLES)
            out.append(Region((x - origin[0], y - origin[1]), heading, **size))
        elif shape.tag == "polygon":
            corners = _polygon(xml, owner, shape) - np.asarray(origin)
            if len(corners) < 3:
                raise xml.fail(owner, "a goal polygon has fewer than 3 points")
            middle = corners.mean(0)
            out.append(Region((float(middle[0]), float(middle[1])), corners=corners))
        elif shape.tag == "point":
            x, y = (xml.number(owner, xml.text(shape, axis, owner), axis) for axis in "xy")
            out.append(Region((x - origin[0], y - origin[1])))
    return out
