"""SUMO networks (.net.xml): lanes, the connections between them, and the fixed-time programs of their signals."""

import dataclasses
from collections.abc import Hashable
from typing import Any, no_type_check

import numpy as np

from urbanjax.io.maps.centre import borders
from urbanjax.io.maps.lanes import assemble
from urbanjax.io.maps.road import MapFault, MapLane, RoadMap
from urbanjax.io.maps.xml import LASTS, SPEED_LIMITS, Element, Xml
from urbanjax.roadmap.graph import RoadType, Rule, Turn
from urbanjax.sim.signals import SignalCycle
from urbanjax.types import SignalState, host_record

WIDTH = 3.2  # m, of lanes that state none
WIDTHS = (0.1, 100.0)  # m, that a lane may state
TURNS = {"l": Turn.LEFT, "L": Turn.LEFT, "r": Turn.RIGHT, "R": Turn.RIGHT, "t": Turn.U_TURN}
RULES = {"m": Rule.YIELD, "s": Rule.STOP, "w": Rule.STOP}
SHOWN = {"g": SignalState.GREEN, "y": SignalState.YELLOW, "r": SignalState.RED, "u": SignalState.RED}
SHOWN |= {"G": SignalState.GREEN, "Y": SignalState.YELLOW, "s": SignalState.RED}


@host_record
class Connection:
    """A way from one lane to the next."""

    start: str
    via: str | None  # the lane inside the junction
    end: str
    turn: Turn
    state: str
    signal: tuple[str, int] | None  # traffic light and link index


def read(xml: Xml) -> RoadMap:
    """The map of a SUMO network: all lanes that cars may use, with those inside junctions as links of their own.

    A signal is named (traffic light, link index), the first index of those that always show the same. It governs the
    end of the lane before the junction where all ways on from there show the same, otherwise the start of the links
    inside. The rule "yield" holds at the end of lanes from which every way but a turn around is a minor one, and of
    links inside a junction that end where one waits.
    Args: xml, the parsed file. Raises MapError, naming the file and the element.
    """
    edges: dict[str, Element] = {}
    for edge in xml.root.findall("edge"):
        if edges.setdefault(xml.attribute(edge, "id"), edge) is not edge:
            raise xml.fail(edge, "the id occurs twice")
    lanes = {
        (e, xml.integer(lane, xml.attribute(lane, "index"), "index")): lane
        for e in edges
        for lane in edges[e].findall("lane")
    }
    names = {key: xml.attribute(lane, "id") for key, lane in lanes.items()}
    drivable = {names[key] for key, lane in lanes.items() if _cars(lane) and _road(edges[key[0]])}
    links, faults = _connections(xml, names)
    links = [c for c in links if c.start in drivable and c.end in drivable]
    programs = _programs(xml)
    shown = {c.signal: _sequence(xml, programs, c.signal) for c in links if c.signal is not None}
    same: dict[Any, tuple[str, int]] = {}
    for signal in sorted(shown):
        same.setdefault((signal[0], shown[signal][1]), signal)
    groups = {signal: same[signal[0], shown[signal][1]] for signal in shown}
    ways = _ways(links, drivable, groups)
    stated = [
        _lane(xml, edges[edge], lane, names, (edge, index), drivable, ways)
        for (edge, index), lane in lanes.items()
        if names[edge, index] in drivable
    ]
    kinds = [junction.get("type", "") for junction in xml.root.findall("junction")]
    counts = {f"junction {kind}": kinds.count(kind) for kind in dict.fromkeys(kinds)}
    counts |= {"lanes": len(lanes), "lanes in junctions": sum(edge.startswith(":") for edge, _ in lanes)}
    counts |= {"lanes without cars": len(lanes) - len(drivable), "edges": len(edges), "tlLogic": len(programs)}
    found = assemble(xml.path, "SUMO", lanes=stated, other=counts)
    cycles = tuple(SignalCycle(*shown[signal]) for signal in found.signal_ids)
    return dataclasses.replace(found, cycles=cycles, faults=(*found.faults, *faults))


def _cars(lane: Element) -> bool:
    """Whether a lane is open to passenger cars."""
    allow, disallow = lane.get("allow"), (lane.get("disallow") or "").split()
    if allow:
        return bool({"passenger", "all"} & set(allow.split()))
    return not {"passenger", "all"} & set(disallow)


def _road(edge: Element) -> bool:
    return edge.get("function", "normal") in ("normal", "internal")


def _connections(xml: Xml, names: dict[tuple[str, int], str]) -> tuple[list[Connection], list[MapFault]]:
    """All connections whose lanes exist, and what is said of the others."""
    known, out, faults = set(names.values()), [], []
    for element in xml.root.findall("connection"):
        ends = []
        for end in ("from", "to"):
            index = xml.integer(element, xml.attribute(element, f"{end}Lane"), f"{end}Lane")
            ends.append((xml.attribute(element, end), index))
        via, tl = element.get("via"), element.get("tl")
        absent = [f"{edge}_{index}" for edge, index in ends if (edge, index) not in names]
        absent += [via] if via is not None and via not in known else []
        if absent:
            at = f"{ends[0][0]}_{ends[0][1]}"
            faults.append(MapFault("dangling link", at, f"the lane {absent[0]!r} of a connection is missing"))
            continue
        signal = None if tl is None else (tl, xml.integer(element, xml.attribute(element, "linkIndex"), "linkIndex"))
        turn = TURNS.get(element.get("dir", "s"), Turn.STRAIGHT)
        out.append(Connection(names[ends[0]], via, names[ends[1]], turn, element.get("state", "M"), signal))
    return out, faults


def _programs(xml: Xml) -> dict[str, tuple[Element, tuple[float, ...], list[str], float]]:
    """Durations, states and offset of each traffic light; the first program counts."""
    out: dict[str, tuple[Element, tuple[float, ...], list[str], float]] = {}
    for logic in xml.root.findall("tlLogic"):
        phases = logic.findall("phase")
        lasts = tuple(xml.number(logic, xml.attribute(p, "duration"), "duration", 0.0, LASTS) for p in phases)
        if sum(lasts) <= 0:
            raise xml.fail(logic, "its phases have no duration")
        offset = xml.number(logic, logic.get("offset", "0"), "offset")
        states = [xml.attribute(p, "state") for p in phases]
        out.setdefault(xml.attribute(logic, "id"), (logic, lasts, states, offset))
    return out


def _sequence(xml: Xml, programs: dict[str, Any], signal: tuple[str, int]) -> tuple[tuple, tuple, float]:
    """What `SignalCycle` holds of one link index of a traffic light."""
    if signal[0] not in programs:
        raise xml.fail(xml.root, f"a connection names the traffic light {signal[0]!r}, which has no <tlLogic>")
    logic, lasts, states, offset = programs[signal[0]]
    if any(len(state) <= signal[1] for state in states):
        raise xml.fail(logic, f"a phase has no state for the link index {signal[1]}")
    return lasts, tuple(int(SHOWN.get(state[signal[1]], SignalState.UNKNOWN)) for state in states), offset


@no_type_check
@dataclasses.dataclass
class _Way:
    """What the connections say of one lane."""

    successors: list[Hashable] = dataclasses.field(default_factory=list)
    turn: Turn | None = None
    rule: Rule = Rule.NONE
    end_signal: tuple[str, int] | None = None
    start_signals: list[tuple[str, int]] = dataclasses.field(default_factory=list)


def _ways(links: list[Connection], drivable: set[str], groups: dict[Any, tuple[str, int]]) -> dict[str, _Way]:
    """Successors, turn, rule and signals of each lane."""
    ways = {lane: _Way() for lane in drivable}
    leaving: dict[str, list[Connection]] = {}
    for c in links:
        leaving.setdefault(c.start, []).append(c)
        through = c.via if c.via in drivable else None
        ways[c.start].successors.append(through or c.end)
        if through:
            ways[through].turn = c.turn
    for lane, group in leaving.items():
        signals = {None if c.signal is None else groups[c.signal] for c in group}
        if len(signals) == 1:
            ways[lane].end_signal = signals.pop()
        else:
            for c in group:
                if c.signal is not None and c.via in drivable:
                    ways[c.via].start_signals.append(groups[c.signal])
        rules = [RULES.get(c.state, Rule.NONE) for c in group if c.turn != Turn.U_TURN]
        if not any(c.signal for c in group):
            ways[lane].rule = min(rules, default=Rule.NONE)
    return ways


def _lane(
    xml: Xml,
    edge: Element,
    lane: Element,
    names: dict[tuple[str, int], str],
    key: tuple[str, int],
    drivable: set[str],
    ways: dict[str, _Way],
) -> MapLane:
    """One lane; indices count from the right."""
    pairs = [point.split(",")[:2] for point in xml.attribute(lane, "shape").split()]
    if len(pairs) < 2 or any(len(pair) < 2 for pair in pairs):
        raise xml.fail(lane, "its shape has not two points or more of two coordinates each")
    centre = xml.points(lane, [(x, y) for x, y in pairs], "its shape")
    left, right = borders(centre, xml.number(lane, lane.get("width", str(WIDTH)), "width", *WIDTHS))
    inside, way = edge.get("function") == "internal", ways[names[key]]
    sides: dict[str, Any] = {}
    for side, step in (("left", 1), ("right", -1)):
        beside = names.get((key[0], key[1] + step))
        if beside in drivable:
            allowed = lane.get(f"change{side.capitalize()}")
            permitted = allowed is None or bool({"all", "passenger"} & set(allowed.split()))
            sides |= {f"{side}_id": beside, f"{side}_change": permitted and not inside}
    signals: list[tuple[Hashable, np.ndarray | None]] = [(signal, centre[0]) for signal in way.start_signals]
    signals += [(way.end_signal, None)] if way.end_signal else []
    highway = edge.get("type", "").startswith("highway.motorway")
    return MapLane(
        id=names[key],
        left=left,
        right=right,
        paired=True,
        drawn=False,
        successors=tuple(way.successors),
        speed_limit=xml.number(lane, xml.attribute(lane, "speed"), "speed", *SPEED_LIMITS),
        turn=(way.turn or Turn.STRAIGHT) if inside else Turn.STRAIGHT,
        road_type=RoadType.JUNCTION if inside else RoadType.HIGHWAY if highway else RoadType.URBAN,
        rule=way.rule,
        signals=tuple(dict(signals).items()),
        **sides,
    )
