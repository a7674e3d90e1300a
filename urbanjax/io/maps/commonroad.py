"""CommonRoad XML, versions 2018b and 2020a: lanelets with their rules, recorded obstacles, planning problems."""

import dataclasses
from collections.abc import Hashable
from typing import Any

import numpy as np

from urbanjax.io.maps.lanes import assemble, may_cross
from urbanjax.io.maps.obstacles import planning_problems, recording
from urbanjax.io.maps.road import MapFault, MapLane, RoadMap
from urbanjax.io.maps.xml import FARTHEST, LASTS, SPEED_LIMITS, Element, Xml
from urbanjax.roadmap.graph import RoadType, Rule, Turn
from urbanjax.sim.signals import SignalCycle
from urbanjax.types import SignalState

STEPS = (1e-4, 1e3)  # s, a time step
VERSIONS = ("2018b", "2020a")
SPEED_SIGNS = {"274", "274.1", "R2-1", "r301", "3.24", "C43", "B14", "R32", "B31"}  # maximum speed, by country
STOP_SIGNS = {"206", "R1-1", "r2"}
YIELD_SIGNS = {"205", "R1-2", "r1"}
UNITS = {"kmh": 1 / 3.6, "km/h": 1 / 3.6, "mph": 0.44704}  # written after some speeds; plain values are in m/s
HIGHWAYS = {"highway", "interstate", "mainCarriageWay"}
RAMPS = {"accessRamp", "exitRamp"}
UNDRIVABLE = {"crosswalk", "sidewalk", "bicycleLane", "border", "parking"}
DRIVERS = {"vehicle", "car", "truck", "bus", "motorcycle", "priorityVehicle", "taxi"}
COLOURS = {"red": SignalState.RED, "redYellow": SignalState.RED, "yellow": SignalState.YELLOW}
COLOURS |= {"green": SignalState.GREEN, "inactive": SignalState.UNKNOWN}
TURNS = {"successorsLeft": Turn.LEFT, "successorsStraight": Turn.STRAIGHT, "successorsRight": Turn.RIGHT}


def read(xml: Xml) -> RoadMap:
    """The map of a CommonRoad file, with its `Recording` and planning problems.

    Successors, neighbours and permissions to change are as stated; a border without marking permits a change. Turns
    come from the intersections, elsewhere from the headings. Speed limits are in m/s; lanelets that only pedestrians
    or cyclists use are counted in `other`.
    Args: xml, the parsed file. Raises MapError, naming the file and the element.
    """
    version = xml.root.get("commonRoadVersion")
    if version not in VERSIONS:
        raise xml.fail(xml.root, f"commonRoadVersion is {version!r}, expected one of {', '.join(VERSIONS)}")
    dt = xml.number(xml.root, xml.attribute(xml.root, "timeStepSize"), "timeStepSize", *STEPS)
    signs = {xml.id(sign): sign for sign in xml.root.findall("trafficSign")}
    lights = {xml.id(light): light for light in xml.root.findall("trafficLight") if _active(light)}
    turns = _turns(xml)
    highway = bool(_tags(xml) & HIGHWAYS) and "intersection" not in _tags(xml)
    elements = xml.root.findall("lanelet")
    drivable = {xml.id(element): element for element in elements if _drivable(element)}
    foot = {xml.id(element) for element in elements} - drivable.keys()
    lanes = [_lane(xml, e, foot, signs, lights, turns, highway) for e in elements if xml.id(e) in drivable]
    absent = [
        MapFault("dangling link", xml.id(element), f"its {kind} {ref.get('ref')!r} is missing")
        for element in elements
        for kind, known in (("trafficSign", signs), ("trafficLight", lights))
        for ref in element.iter(f"{kind}Ref")
        if xml.id(ref, "ref") not in known
    ]
    counts = {tag: len(xml.root.findall(tag)) for tag in ("trafficSign", "trafficLight", "intersection")}
    counts["undrivable lanelets"] = len(foot)
    found = assemble(xml.path, f"CommonRoad {version}", lanes=lanes, other={k: n for k, n in counts.items() if n})
    cycles = tuple(_cycle(xml, lights[g], dt) for g in found.signal_ids)
    return dataclasses.replace(
        found,
        faults=(*found.faults, *absent),
        cycles=cycles,
        recording=recording(xml, dt, found=found),
        problems=planning_problems(xml, dt, found=found),
    )


def _lane(
    xml: Xml,
    element: Element,
    foot: set[int],
    signs: dict[int, Element],
    lights: dict[int, Element],
    turns: dict[int, Turn],
    highway: bool,
) -> MapLane:
    """One lanelet."""
    number = xml.id(element)
    left, right = (_border(xml, element, tag) for tag in ("leftBound", "rightBound"))
    sides: dict[str, Any] = {}
    for side, (_, marking) in (("left", left), ("right", right)):
        beside = element.find(f"adjacent{side.capitalize()}")
        if beside is None or xml.id(beside, "ref") in foot:
            continue
        same = xml.attribute(beside, "drivingDir") == "same"
        if same or side == "left":
            sides[f"{side}_id" if same else "opposite_id"] = xml.id(beside, "ref")
            sides[f"{side}_change"] = may_cross(marking, side)
    rule, limit = _rule(xml, element, signs)
    return MapLane(
        id=number,
        left=left[0],
        right=right[0],
        paired=len(left[0]) == len(right[0]),
        successors=_refs(xml, element, "successor", foot),
        predecessors=_refs(xml, element, "predecessor", foot),
        speed_limit=limit,
        turn=turns.get(number),
        road_type=_road_type(element, number in turns, highway),
        **{"entry_rule" if _at_start(xml, element, number in turns, left[0]) else "rule": rule},
        signals=_signals(xml, element, lights),
        **sides,
    )


def _border(xml: Xml, lanelet: Element, tag: str) -> tuple[Any, str | None]:
    """Points [n, 2] of a border and its marking."""
    bound = xml.child(lanelet, tag)
    points = xml.points(lanelet, [(p.findtext("x"), p.findtext("y")) for p in bound.findall("point")], tag)
    if len(points) < 2:
        raise xml.fail(lanelet, f"{tag} has {len(points)} points, expected 2 or more")
    marking = bound.findtext("lineMarking")
    return points, None if marking is None else marking.strip()


def _refs(xml: Xml, element: Element, tag: str, without: set[int]) -> tuple[Hashable, ...]:
    return tuple(ref for ref in (xml.id(e, "ref") for e in element.findall(tag)) if ref not in without)


def _drivable(element: Element) -> bool:
    users = {(e.text or "").strip() for tag in ("userOneWay", "userBidirectional") for e in element.findall(tag)}
    return not (_types(element) & UNDRIVABLE) and (not users or bool(users & DRIVERS))


def _types(element: Element) -> set[str]:
    return {(e.text or "").strip() for e in element.findall("laneletType")}


def _road_type(element: Element, in_junction: bool, highway: bool) -> RoadType | None:
    """Kind of road; None where only the geometry can tell a junction."""
    types = _types(element)
    if in_junction or "intersection" in types:
        return RoadType.JUNCTION
    if types & RAMPS:
        return RoadType.RAMP
    return RoadType.HIGHWAY if types & HIGHWAYS or highway else None


def _tags(xml: Xml) -> set[str]:
    """The scenario's tags: an attribute in 2018b, elements in 2020a."""
    element = xml.root.find("scenarioTags")
    return set(xml.root.get("tags", "").split()) | {tag.tag for tag in (() if element is None else element)}


def _turns(xml: Xml) -> dict[int, Turn]:
    """Which way the lanelets turn that follow the incoming ones of intersections."""
    out = {}
    for incoming in xml.root.iterfind("intersection/incoming"):
        for tag, turn in TURNS.items():
            out |= {xml.id(element, "ref"): turn for element in incoming.findall(tag)}
    return out


def _rule(xml: Xml, lanelet: Element, signs: dict[int, Element]) -> tuple[Rule, float | None]:
    """Priority rule and speed limit [m/s] of a lanelet; the lowest limit counts."""
    rule, limits = Rule.NONE, []
    own = lanelet.find("speedLimit")
    if own is not None:
        limits.append(_speed(xml, lanelet, own.text or "", "speedLimit"))
    for ref in lanelet.iter("trafficSignRef"):
        sign = signs.get(xml.id(ref, "ref"))
        if sign is None:
            continue
        for element in sign.findall("trafficSignElement"):
            kind = xml.text(element, "trafficSignID", sign)
            if kind in SPEED_SIGNS:
                limits.append(_speed(xml, sign, xml.text(element, "additionalValue", sign), "additionalValue"))
            rule = Rule.STOP if kind in STOP_SIGNS else max(rule, Rule.YIELD) if kind in YIELD_SIGNS else rule
    return rule, min(limits, default=None)


def _at_start(xml: Xml, lanelet: Element, in_junction: bool, left: np.ndarray) -> bool:
    """Whether a lanelet's signs ask for something at its start: of those in a junction, or by the stop line."""
    stop = _stop_line(xml, lanelet)
    if stop is None:
        return in_junction or "intersection" in _types(lanelet)
    return bool(np.hypot(*(left[0] - stop)) < np.hypot(*(left[-1] - stop)))


def _stop_line(xml: Xml, lanelet: Element) -> np.ndarray | None:
    """Middle [2] of a lanelet's stop line; None where it has none, or one at its end."""
    line = lanelet.find("stopLine")
    ends = [] if line is None else [(p.findtext("x"), p.findtext("y")) for p in line.findall("point")]
    return xml.points(lanelet, ends, "stopLine").mean(0) if ends else None


def _speed(xml: Xml, element: Element, text: str, what: str) -> float:
    text = text.strip()
    unit = next((unit for unit in UNITS if text.endswith(unit)), "")
    return xml.number(element, text.removesuffix(unit), what, *SPEED_LIMITS) * UNITS.get(unit, 1.0)


def _active(light: Element) -> bool:
    return light.findtext("active", "true").strip() != "false"


def _signals(xml: Xml, lanelet: Element, lights: dict[int, Element]) -> tuple[tuple[Hashable, Any], ...]:
    """The traffic lights of a lanelet, each with the middle of its stop line."""
    refs = dict.fromkeys(xml.id(ref, "ref") for ref in lanelet.iter("trafficLightRef"))
    stop = _stop_line(xml, lanelet)
    return tuple((ref, stop) for ref in refs if ref in lights)


def _cycle(xml: Xml, light: Element, dt: float) -> SignalCycle | None:
    """The program of a traffic light, from multiples of the time step."""
    cycle = light.find("cycle")
    if cycle is None or cycle.find("cycleElement") is None:
        return None
    durations, states = [], []
    for phase in cycle.findall("cycleElement"):
        durations.append(xml.number(light, xml.text(phase, "duration", light), "duration", 0.0, LASTS) * dt)
        colour = xml.text(phase, "color", light)
        if colour not in COLOURS:
            raise xml.fail(light, f"a phase has the colour {colour!r}, expected one of {', '.join(COLOURS)}")
        states.append(int(COLOURS[colour]))
    offset = xml.number(light, cycle.findtext("timeOffset", "0"), "timeOffset", 0.0, FARTHEST) * dt
    if sum(durations) <= 0:
        raise xml.fail(light, "its cycle has no duration")
    return SignalCycle(tuple(durations), tuple(states), offset)
