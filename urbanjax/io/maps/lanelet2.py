"""Lanelet2 maps (.osm): lanelets between ways, their rules and regulatory elements."""

import dataclasses
from collections.abc import Hashable
from typing import Any

import numpy as np

from urbanjax.io.maps.geodesy import transverse_mercator
from urbanjax.io.maps.lanes import assemble
from urbanjax.io.maps.regulation import Regulation, regulations
from urbanjax.io.maps.road import MapFault, MapLane, RoadMap
from urbanjax.io.maps.xml import ID, SPEED_LIMITS, Element, Xml
from urbanjax.roadmap.builders.relations import project
from urbanjax.roadmap.graph import RoadType, Rule, Turn
from urbanjax.types import host_record

POLAR = 85.0  # deg, latitude beyond which the projection is of no use
SIDES = ("left", "right")
APART = 1.0  # deg, from the middle of a map to its farthest node
ROADS = {"road", "highway", "play_street", "exit"}  # subtypes that cars may use unless a participant tag says otherwise
TURNS = {"left": Turn.LEFT, "right": Turn.RIGHT, "straight": Turn.STRAIGHT, "u_turn": Turn.U_TURN}
UNITS = {"km/h": 1 / 3.6, "kmh": 1 / 3.6, "mph": 0.44704, "m/s": 1.0, "mps": 1.0}  # without a unit: km/h
LIMITS = {("road", "nonurban"): 100 / 3.6, ("highway", "urban"): 80 / 3.6, ("play_street", "urban"): 7 / 3.6}  # m/s
LIMITS |= {("highway", "nonurban"): 120 / 3.6, ("play_street", "nonurban"): 7 / 3.6}


@host_record
class Border:
    """A way as the border of a lanelet, in driving direction."""

    way: int
    nodes: tuple[int, ...]
    points: np.ndarray  # [n, 2] m
    turned: bool  # against the way's own direction
    tags: dict[str, str]


@host_record
class Lanelet:
    """A lanelet in one of its driving directions; the id of the other one has the other sign."""

    id: int
    relation: int  # that states it; editors give new ones negative ids
    left: Border
    right: Border
    tags: dict[str, str]
    regulatory: tuple[int, ...]


def read(xml: Xml) -> RoadMap:
    """The map of a Lanelet2 file.

    Coordinates are `local_x`, `local_y` where the nodes have them; otherwise metres around the middle of the nodes in
    a transverse Mercator projection (see `geodesy`; `RoadMap.geo` holds the middle). Lanelets follow each other where
    both borders share end points, lie beside each other where they share a way, whose type or `lane_change` tag tells
    whether it may be crossed; one driven both ways (`one_way` no) becomes two, the second with the id of other sign.
    A signal is named after the ways of its lights, in order; it stands at the reference line. Lanelets without cars are
    counted in `other`.
    Args: xml, the parsed file. Raises MapError, naming the file and the element.
    """
    ways = {xml.id(way): way for way in xml.root.findall("way")}
    relations = {xml.id(relation): relation for relation in xml.root.findall("relation")}
    lanelets = {key: e for key, e in relations.items() if tags(e).get("type") == "lanelet"}
    drivable = {key: e for key, e in lanelets.items() if _cars(tags(e))}
    rules = regulations(xml, relations, ways=ways)
    borders = [(e, way) for e in drivable.values() for side in SIDES for way in members(xml, e, kind="way", role=side)]
    for element, way in borders:
        if way not in ways:
            raise xml.fail(element, f"the way {way} is missing, which it names as a border")
    used = {way for _, way in borders} | {way for rule in rules.values() for way in rule.lines}
    place, geo = _places(xml, {node: ways[way] for way in used for node in _nodes(xml, ways[way])})
    parts = [part for key, e in drivable.items() for part in _lanelet(xml, key, e, ways, place)]
    follows, beside = _tables(parts)
    absent = [
        MapFault("dangling link", key, f"its regulatory element {ref} is missing")
        for key, e in drivable.items()
        for ref in members(xml, e, kind="relation", role="regulatory_element")
        if ref not in relations
    ]
    lines = {way: np.array([place[n] for n in _nodes(xml, ways[way])]) for rule in rules.values() for way in rule.lines}
    lanes = [_lane(xml, drivable[part.relation], part, follows, beside, rules, lines) for part in parts]
    subtypes = [tags(e).get("subtype", "") for key, e in lanelets.items() if key not in drivable]
    counts = {f"{kind or 'other'} lanelets": subtypes.count(kind) for kind in dict.fromkeys(subtypes)}
    kinds = [rule.kind for rule in rules.values()]
    counts |= {f"regulatory elements ({kind})": kinds.count(kind) for kind in dict.fromkeys(kinds)}
    found = assemble(xml.path, "Lanelet2", lanes=lanes, other=counts, geo=geo)
    return dataclasses.replace(found, cycles=(None,) * len(found.signal_ids), faults=(*found.faults, *absent))


def tags(element: Element) -> dict[str, str]:
    """The tags of an element.

    Args: element, a node, way or relation.
    """
    return {tag.get("k", ""): tag.get("v", "") for tag in element.findall("tag")}


def members(xml: Xml, relation: Element, *, kind: str, role: str) -> list[int]:
    """Ids of the members with a type and a role.

    Args: xml, the parsed file; relation, whose members they are; kind, their type; role, theirs.
    """
    found = [m for m in relation.findall("member") if m.get("type") == kind and m.get("role") == role]
    return [xml.integer(relation, xml.attribute(m, "ref"), "ref", low=-ID) for m in found]


def _cars(stated: dict[str, str]) -> bool:
    """Whether a lanelet is open to cars: the narrowest participant that is named decides."""
    for key in ("participant:vehicle:car", "participant:vehicle"):
        if key in stated:
            return stated[key] == "yes"
    named = any(key.startswith("participant:") and value == "yes" for key, value in stated.items())
    return stated.get("subtype") in ROADS and not named


def _nodes(xml: Xml, way: Element) -> tuple[int, ...]:
    return tuple(xml.integer(way, xml.attribute(nd, "ref"), "ref", low=-ID) for nd in way.findall("nd"))


def _places(xml: Xml, used: dict[int, Element]) -> tuple[dict[int, np.ndarray], tuple[float, float] | None]:
    """Map coordinates [2] of each node that a way names, and the middle of the projection where there is one."""
    nodes = {key: node for node in xml.root.findall("node") if (key := xml.id(node)) in used}
    missing = used.keys() - nodes.keys()
    if missing:
        raise xml.fail(used[min(missing)], f"the node {min(missing)} is missing, which it names")
    if not nodes:
        raise xml.fail(xml.root, "holds no lanelet that cars may use")
    stated = {key: tags(node) for key, node in nodes.items()}
    local = {key for key, own in stated.items() if "local_x" in own and "local_y" in own}
    if local:
        plain = nodes.keys() - local
        if plain:
            raise xml.fail(nodes[min(plain)], "has no local_x and local_y, which other nodes have")
        pairs = [(stated[key]["local_x"], stated[key]["local_y"]) for key in nodes]
        rows = [
            xml.points(node, [pair], "local_x, local_y")[0] for node, pair in zip(nodes.values(), pairs, strict=True)
        ]
        return dict(zip(nodes, rows, strict=True)), None
    latitude = np.array([xml.number(n, xml.attribute(n, "lat"), "lat", -POLAR, POLAR) for n in nodes.values()])
    longitude = np.array([xml.number(n, xml.attribute(n, "lon"), "lon", -180.0, 180.0) for n in nodes.values()])
    north, east = (round(float(0.5 * (x.min() + x.max())), 6) for x in (latitude, longitude))
    middle = (north, east)
    off = np.maximum(np.abs(latitude - middle[0]), np.abs(longitude - middle[1])) > APART
    if np.any(off):
        raise xml.fail(list(nodes.values())[int(np.argmax(off))], "lies more than a degree from the middle of the map")
    x, y = transverse_mercator(latitude, longitude, middle=middle)
    return dict(zip(nodes, np.stack([x, y], -1), strict=True)), middle


def _lanelet(
    xml: Xml, key: int, element: Element, ways: dict[int, Element], place: dict[int, np.ndarray]
) -> list[Lanelet]:
    """A lanelet in its driving direction, and in the other one where it has both."""
    borders = []
    for role in SIDES:
        named = members(xml, element, kind="way", role=role)
        if len(named) != 1:
            raise xml.fail(element, f"has {len(named)} {role} borders, expected 1")
        nodes = _nodes(xml, ways[named[0]])
        if len(nodes) < 2:
            raise xml.fail(ways[named[0]], f"has {len(nodes)} points, expected 2 or more")
        borders.append(Border(named[0], nodes, np.array([place[n] for n in nodes]), False, tags(ways[named[0]])))
    left, right = borders
    # The direction of a way says nothing: a lanelet runs so that its left border is on the left.
    left = _turned(left) if _side(left, right) > 0 else left
    right = _turned(right) if _side(right, left) < 0 else right
    stated = tags(element)
    regulatory = tuple(members(xml, element, kind="relation", role="regulatory_element"))
    ahead = Lanelet(key, key, left, right, stated, regulatory)
    if stated.get("one_way", "yes") != "no":
        return [ahead]
    return [ahead, Lanelet(-key, key, _turned(right), _turned(left), stated, regulatory)]


def _turned(border: Border) -> Border:
    return dataclasses.replace(border, nodes=border.nodes[::-1], points=border.points[::-1], turned=not border.turned)


def _side(border: Border, other: Border) -> float:
    """Offset [m] of the middle of one border from another, left positive."""
    n = len(other.points)
    middle = other.points[n // 2] if n > 2 else other.points.mean(0)
    return float(project(middle[None], border.points)[2][0])


def _tables(parts: list[Lanelet]) -> tuple[dict[Any, list[int]], dict[Any, list[int]]]:
    """Lanelets by the first nodes of their borders, and by side, way and direction of each border."""
    starts: dict[Any, list[int]] = {}
    sides: dict[Any, list[int]] = {}
    for part in parts:
        starts.setdefault((part.left.nodes[0], part.right.nodes[0]), []).append(part.id)
        for side, border in (("left", part.left), ("right", part.right)):
            sides.setdefault((side, border.way, border.turned), []).append(part.id)
    return starts, sides


def _lane(
    xml: Xml,
    element: Element,
    part: Lanelet,
    follows: dict[Any, list[int]],
    beside: dict[Any, list[int]],
    rules: dict[int, Regulation],
    lines: dict[int, np.ndarray],
) -> MapLane:
    """One lanelet in one direction."""
    sides: dict[str, Any] = {}
    for side, other, border in (("left", "right", part.left), ("right", "left", part.right)):
        same = [key for key in beside.get((other, border.way, border.turned), []) if key != part.id]
        if same:
            sides |= {f"{side}_id": same[0], f"{side}_change": may_cross(border, side)}
    oncoming = [key for key in beside.get(("left", part.left.way, not part.left.turned), []) if key != -part.id]
    if "left_id" not in sides and oncoming:
        sides |= {"opposite_id": oncoming[0], "left_change": may_cross(part.left, "left")}
    kind = (part.tags.get("subtype", "road"), part.tags.get("location", "urban"))
    turn = TURNS.get(part.tags.get("turn_direction", ""))
    junction = turn is not None or "intersection_area" in part.tags
    signals: dict[Hashable, np.ndarray | None] = {}
    rule = Rule.NONE
    for ref in part.regulatory:
        if ref in rules:
            rule = max(rule, rules[ref].rule(part.relation))
            if rules[ref].signal is not None:
                signals.setdefault(rules[ref].signal, _stop(rules[ref], lines, part))
    return MapLane(
        id=part.id,
        left=part.left.points,
        right=part.right.points,
        successors=tuple(
            key for key in follows.get((part.left.nodes[-1], part.right.nodes[-1]), []) if key != -part.id
        ),
        speed_limit=_limit(xml, element, part.tags, LIMITS.get(kind)),
        turn=turn,
        road_type=RoadType.JUNCTION if junction else RoadType.HIGHWAY if kind[0] == "highway" else None,
        **{"entry_rule" if junction else "rule": rule},
        signals=tuple(signals.items()),
        **sides,
    )


def may_cross(border: Border, side: str) -> bool:
    """Whether a border may be crossed to `side`: its `lane_change` tags say so, or else its type.

    Args: border of the lanelet; side, left or right.
    """
    # Tags and halves of double lines are named looking along the way.
    seen = side if not border.turned else {"left": "right", "right": "left"}[side]
    for key in (f"lane_change:{seen}", "lane_change"):
        if key in border.tags:
            return border.tags[key] == "yes"
    halves = border.tags.get("subtype", "").split("_")
    painted = border.tags.get("type") in ("line_thin", "line_thick")
    return painted and halves[-1 if seen == "left" else 0] == "dashed"


def _limit(xml: Xml, element: Element, stated: dict[str, str], default: float | None) -> float | None:
    """Speed limit [m/s] of a lanelet."""
    text = stated.get("speed_limit")
    if text is None:
        return default
    unit = next((unit for unit in UNITS if text.strip().endswith(unit)), "")
    return xml.number(element, text.strip().removesuffix(unit), "speed_limit", *SPEED_LIMITS) * UNITS.get(unit, 1 / 3.6)


def _stop(rule: Regulation, lines: dict[int, np.ndarray], part: Lanelet) -> np.ndarray | None:
    """Middle [2] of the reference line nearest to the lanelet's end."""
    end = 0.5 * (part.left.points[-1] + part.right.points[-1])
    middles = [lines[way].mean(0) for way in rule.lines]
    return min(middles, key=lambda at: float(np.hypot(*(at - end))), default=None)
