"""Regulatory elements of Lanelet2 maps: signals, rights of way, signs."""

from collections.abc import Hashable

from urbanjax.io.maps.xml import ID, Element, Xml
from urbanjax.roadmap.graph import Rule
from urbanjax.types import host_record

STOP_SIGNS = {"stop_sign", "de206", "usR1-1", "stop"}
YIELD_SIGNS = {"yield_sign", "de205", "usR1-2", "yield"}


@host_record
class Regulation:
    """One regulatory element."""

    kind: str
    signal: Hashable | None  # ways of the lights that show the same, or that way where it is one
    lines: tuple[int, ...]  # ways of its reference lines
    sign: Rule  # what its sign asks of all its lanelets
    yielding: frozenset[int]  # lanelets that yield

    def rule(self, lanelet: int) -> Rule:
        """What it asks of a lanelet."""
        return max(self.sign, Rule.YIELD if lanelet in self.yielding else Rule.NONE)


def regulations(xml: Xml, relations: dict[int, Element], *, ways: dict[int, Element]) -> dict[int, Regulation]:
    """The regulatory elements of a map by their ids; missing ways and lanelets that they name do not count.

    Args: xml, the parsed file; relations and ways by their ids.
    """
    out = {}
    for key, element in relations.items():
        stated = _tags(element)
        if stated.get("type") != "regulatory_element":
            continue
        kind = stated.get("subtype", "")
        named: dict[str, list[int]] = {}
        for member in element.findall("member"):
            ref = xml.integer(element, xml.attribute(member, "ref"), "ref", low=-ID)
            named.setdefault(member.get("role", ""), []).append(ref)
        lights = sorted({*named.get("refers", ())} or {key})
        signs = {stated.get("sign_type", "")}
        for way in (ways[ref] for ref in named.get("refers", ()) if ref in ways):
            signs |= {_tags(way).get("subtype", ""), _tags(way).get("sign_type", "")}
        sign = Rule.NONE
        if kind in ("traffic_sign", "all_way_stop", "right_of_way"):
            yields = Rule.YIELD if kind == "traffic_sign" and signs & YIELD_SIGNS else Rule.NONE
            stops = kind == "all_way_stop" or (kind == "traffic_sign" and signs & STOP_SIGNS)
            sign = Rule.STOP if stops else yields
        out[key] = Regulation(
            kind=kind,
            signal=(tuple(lights) if len(lights) > 1 else lights[0]) if kind == "traffic_light" else None,
            lines=tuple(ref for ref in named.get("ref_line", ()) if ref in ways),
            sign=sign,
            yielding=frozenset(named.get("yield", ())) if kind == "right_of_way" else frozenset(),
        )
    return out


def _tags(element: Element) -> dict[str, str]:
    return {tag.get("k", ""): tag.get("v", "") for tag in element.findall("tag")}
