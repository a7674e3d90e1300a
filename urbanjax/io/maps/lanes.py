"""The road graph of the lanes that a map states."""

from collections import Counter
from collections.abc import Hashable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from urbanjax.io.maps.centre import SHORTEST, WIDEST, CentreLine, centre_line, stations
from urbanjax.io.maps.road import MapFault, MapLane, RoadMap
from urbanjax.io.maps.xml import MapError
from urbanjax.roadmap import builders
from urbanjax.roadmap.graph import RoadType, Rule, Turn
from urbanjax.types import RoadError

SPACING = 2.0  # m, between the points of the longest link
POINTS = (16, 32, 64, 128)  # per link
FARTHEST = 20_000.0  # m from the middle of a map, per axis: beyond, float32 loses more than a millimetre
MEETING = 0.5  # m, between ends that are the same place
GAP = 3.0  # m from a lane's end to its successor's start, beyond which the link is left out
TURNING = np.radians(30.0)  # change of heading from which a link of a fork turns
BACK = np.radians(150.0)  # and from which it turns back
MOST_LANES = 20_000
DEFAULT_LIMIT = {RoadType.HIGHWAY: 120 / 3.6, RoadType.RAMP: 80 / 3.6}  # m/s, where a map has none
TOWN = 50 / 3.6  # m/s, where a map has none, on all other roads
REACH = 10.0  # m from a lane, within which a stop line is its own


def assemble(path: Path, form: str, *, lanes: Sequence[MapLane], gap: float = GAP, **rest: Any) -> RoadMap:
    """The road graph of the lanes, around the middle of the map.

    References to lanes that are missing, lie too far away or are the lane itself are left out, and so are lanes
    shorter than 0.1 m, whose predecessors then lead to their successors; `faults` lists all of these. Where the map
    does not say which way a lane turns, its heading tells, at forks; lanes of unknown type that cross others are
    junction links.
    Args: path of the file; form, the name of its format; lanes, as the map states them; gap [m] from a lane's end to
    its successor's start, beyond which the link is left out; rest, other fields of the map. Raises MapError where
    nothing usable remains.
    """
    if not lanes:
        raise MapError(f"{path}: holds no lane that can be driven")
    if len(lanes) > MOST_LANES:
        raise MapError(f"{path}: holds {len(lanes)} lanes, more than the {MOST_LANES} that a map may have")
    twice = [lane for lane, count in Counter(lane.id for lane in lanes).items() if count > 1]
    if twice:
        raise MapError(f"{path}: the lane {twice[0]!r} occurs twice")
    faults: list[MapFault] = _too_far_or_wide(path, lanes)
    lines = {lane.id: centre_line(lane) for lane in lanes}
    kept = [lane for lane in lanes if lines[lane.id].length >= SHORTEST]
    if not kept:
        raise MapError(f"{path}: none of its {len(lanes)} lanes has a length")
    faults += [MapFault("zero length", lane.id, "left out") for lane in lanes if lines[lane.id].length < SHORTEST]
    successors = _successors(lanes, lines, gap, faults)
    sides = _sides(kept, lines, faults)
    forks = {j for following in successors.values() if len(following) > 1 for j in following}
    numbers = {g: i for i, g in enumerate(dict.fromkeys(g for lane in kept for g, _ in lane.signals))}
    rules = _rules(lanes, successors)
    specs = []
    for lane in kept:
        line, ahead = lines[lane.id], tuple(successors[lane.id])
        turn = lane.turn if lane.turn is not None else _turn(line) if lane.id in forks else Turn.STRAIGHT
        signals = tuple((numbers[g], _stop(line, at)) for g, at in lane.signals)
        stated = {"turn": turn, "rule": rules[lane.id], "signals": signals, "successors": ahead, **sides[lane.id]}
        specs.append(_spec(lane, line, stated))
    longest = max(line.length for line in lines.values())
    n_points = next((n for n in POINTS if longest <= (n - 1) * SPACING), POINTS[-1])
    ends = np.concatenate([lines[lane.id].centre for lane in kept])
    middle = np.round(0.5 * (ends.min(0) + ends.max(0))) + 0.0  # no negative zero
    try:
        graph = builders.assemble(specs, n_points, origin=(float(middle[0]), float(middle[1])), gap_tolerance=np.inf)
    except RoadError as error:
        raise MapError(f"{path}: {error}") from error
    return RoadMap(
        graph=graph,
        ids=tuple(lane.id for lane in kept),
        format=form,
        path=path,
        lanes=tuple(lanes),
        faults=tuple(faults),
        signal_ids=tuple(numbers),
        **rest,
    )


def _spec(lane: MapLane, line: CentreLine, stated: dict[str, Any]) -> builders.LaneSpec:
    """What the builder needs of a lane."""
    return builders.LaneSpec(
        key=lane.id,
        centre=line.centre,
        heading=line.heading,
        width=line.width,
        speed_limit=lane.speed_limit or DEFAULT_LIMIT.get(lane.road_type or RoadType.URBAN, TOWN),
        road_type=lane.road_type,
        area=lane.area,
        **stated,
    )


def _rules(lanes: Sequence[MapLane], successors: dict[Hashable, list[Hashable]]) -> dict[Hashable, Rule]:
    """Priority rule at the end of each lane; those at the starts of at least half of the ways on count there."""
    entry = {lane.id: lane.entry_rule for lane in lanes}
    out = {}
    for lane in lanes:
        ahead = sorted(entry[j] for j in successors[lane.id])
        out[lane.id] = max(lane.rule, ahead[len(ahead) // 2] if ahead else Rule.NONE)
    return out


def _too_far_or_wide(path: Path, lanes: Sequence[MapLane]) -> list[MapFault]:
    """The lanes whose width is cut; raises MapError for one too far from the others, before anything grows with it."""
    middle = np.median([lane.left[0] for lane in lanes], axis=0)
    out = []
    for lane in lanes:
        left, right = lane.left - middle, lane.right - middle
        if max(np.abs(left).max(), np.abs(right).max()) > FARTHEST:
            raise MapError(f"{path}: the lane {lane.id!r} reaches {FARTHEST / 1000:.0f} km away from the other lanes")
        if np.hypot(*(left[0] - right[0])) > WIDEST or np.hypot(*(left[-1] - right[-1])) > WIDEST:
            out.append(MapFault("too wide", lane.id, f"its borders begin or end more than {WIDEST:.0f} m apart"))
    return out


def may_cross(marking: str | None, side: str) -> bool | None:
    """Whether a line marking permits a change to `side` ("left" or "right"); None where it says nothing.

    Of a double line ("dashed_solid", named from left to right) the half on the own side counts.
    Args: marking, the line's; side, left or right.
    """
    if marking is None or marking == "unknown":
        return None
    parts = [part for part in marking.removeprefix("broad_").split("_") if part in ("solid", "dashed")]
    if not parts:
        return marking in ("no_marking", "lowered_curb", "virtual")
    return parts[0 if side == "right" else -1] == "dashed"


def _successors(
    lanes: Sequence[MapLane], lines: dict[Hashable, CentreLine], gap: float, faults: list[MapFault]
) -> dict[Hashable, list[Hashable]]:
    """Successors of each lane that exist and begin where it ends; lanes without length are passed through.

    A link that only one of its lanes states counts. One that meets only the other way round is turned.
    """
    stated: dict[Hashable, dict[Hashable, None]] = {lane.id: {} for lane in lanes}
    for lane in lanes:
        ahead, behind = ([(lane.id, j) for j in lane.successors], [(j, lane.id) for j in lane.predecessors or ()])
        for i, j in ahead + behind:
            if i in lines and j in lines:
                stated[i][j] = None
            else:
                what, missing = ("predecessor", i) if j == lane.id else ("successor", j)
                faults.append(MapFault("dangling link", lane.id, f"its {what} {missing!r} is missing"))

    def away(i: Hashable, j: Hashable) -> float:
        return float(np.hypot(*(lines[i].centre[-1] - lines[j].centre[0])))

    out: dict[Hashable, dict[Hashable, None]] = {i: {} for i in stated}
    for i in stated:
        for j in _through(i, stated, lines):
            if away(i, j) <= gap:
                out[i][j] = None
            elif i != j and away(j, i) <= MEETING:
                out[j][i] = None
                faults.append(
                    MapFault("turned link", i, f"its successor {j!r} ends where it begins: taken as predecessor")
                )
            else:
                faults.append(
                    MapFault("gap", i, f"its successor {j!r} begins {away(i, j):.1f} m from its end: left out")
                )
    return {i: list(following) for i, following in out.items()}


def _through(
    i: Hashable, stated: dict[Hashable, dict[Hashable, None]], lines: dict[Hashable, CentreLine]
) -> list[Hashable]:
    """The successors of a lane that have a length, reached through those that have none."""
    found, seen, ahead = [], {i} if lines[i].length < SHORTEST else set(), list(reversed(stated[i]))
    while ahead:
        j = ahead.pop()
        if j in seen:
            continue
        seen.add(j)
        if lines[j].length < SHORTEST:
            ahead += reversed(stated[j])
        else:
            found.append(j)
    return found


def _sides(
    lanes: Sequence[MapLane], lines: dict[Hashable, CentreLine], faults: list[MapFault]
) -> dict[Hashable, dict[str, Any]]:
    """Neighbour and permission of each lane on each side, as LaneSpec has them."""
    kept = {lane.id for lane in lanes}
    out: dict[Hashable, dict[str, Any]] = {}
    for lane in lanes:
        row = {}
        for side in ("left", "right"):
            beside, change = getattr(lane, f"{side}_id"), getattr(lane, f"{side}_change")
            if beside is not None and (beside not in kept or beside == lane.id):
                what = "is itself" if beside == lane.id else "has no length" if beside in lines else "is missing"
                faults.append(MapFault("dangling link", lane.id, f"{side} neighbour {beside!r} {what}"))
                beside = None
            # Without a neighbour, permission means that the oncoming lane may be used: the map must say so.
            towards = lane.opposite_id if side == "left" else None
            change = bool(change) and towards in kept if beside is None else change
            row |= {side: beside, f"{side}_change": change}
        out[lane.id] = row
    return out


def _turn(line: CentreLine) -> Turn:
    """Which way a link of a fork turns."""
    change = float(line.heading[-1] - line.heading[0])
    if abs(change) < TURNING:
        return Turn.STRAIGHT
    if abs(change) > BACK:
        return Turn.U_TURN
    return Turn.LEFT if change > 0 else Turn.RIGHT


def _stop(line: CentreLine, at: np.ndarray | None) -> float | None:
    """Station [m] of a stop line through a point; None (the lane's end) where there is none or it lies elsewhere."""
    if at is None:
        return None
    station = stations(line.centre)
    a, d = line.centre[:-1], np.diff(line.centre, axis=0)
    share = np.clip(((at - a) * d).sum(-1) / (d * d).sum(-1), 0.0, 1.0)
    away = np.hypot(*(a + share[:, None] * d - at).T)
    k = int(away.argmin())
    return float(station[k] + share[k] * (station[k + 1] - station[k])) if away[k] < REACH else None
