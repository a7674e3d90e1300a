"""What looks wrong in a map: links that lead nowhere, lanes without length, borders that cross."""

from collections import Counter
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from urbanjax.io.maps.centre import stations
from urbanjax.io.maps.road import MapFault, MapLane, RoadMap
from urbanjax.roadmap.builders.relations import crossing, project
from urbanjax.types import host_record

EDGE = 20.0  # m from the hull of a map, or a twentieth of its size: where lanes may begin and end
CORNERS = 128  # points of a border when it is tested for crossing itself
SHOWN = 3  # faults of a kind that the text shows


@host_record
class Validity:
    """The report on a map."""

    counts: dict[str, int]  # what the map and its graph hold
    length: float  # m, of all links
    faults: tuple[MapFault, ...]

    def text(self) -> str:
        """The report for a reader: counts, then each kind of fault with its first cases."""
        lines = [f"{name}: {count}" for name, count in self.counts.items()]
        lines.append(f"length of all links: {self.length / 1000:.2f} km")
        if not self.faults:
            return "\n".join([*lines, "nothing looks wrong"])
        for kind, count in Counter(fault.kind for fault in self.faults).items():
            cases = [fault for fault in self.faults if fault.kind == kind][:SHOWN]
            lines.append(f"{kind}: {count}")
            lines += [f"  lane {fault.lane}: {fault.detail}" for fault in cases]
            lines += ["  ..."] if count > SHOWN else []
        return "\n".join(lines)


def report(found: RoadMap) -> Validity:
    """What a map holds and what looks wrong in it.

    Kinds of faults: "dangling link" (names what is missing), "gap" and "turned link" (follows, but elsewhere or the
    other way round), "one-sided link", "zero length", "dead end" and "dead start" (a lane inside the map that leads
    nowhere or comes from nowhere, beside which no lane goes on), "self-overlap" (a border crosses itself or the other
    one), "swapped borders", "twice" (two lanes of one centre line).
    Args: found, the map.
    """
    graph = found.graph
    kinds = ("successors", graph.has_successor), ("conflicts", graph.has_conflict), ("stop lines", graph.has_signal)
    counts = {"lanes": len(found.lanes), "links": len(found.ids)}
    counts |= {name: int(np.sum(np.asarray(mask))) for name, mask in kinds}
    counts |= {"neighbours": int(np.sum(np.asarray(graph.has_left)) + np.sum(np.asarray(graph.has_right)))}
    counts |= {"signals": graph.n_signals, **found.other}
    if found.recording is not None:
        counts |= {"road users": len(found.recording.ids), "recorded steps": found.recording.n_times}
    counts |= {"planning problems": len(found.problems)} if found.problems else {}
    faults = [*found.faults, *_one_sided(found), *_dead(found), *_borders(found), *_twice(found)]
    return Validity(counts, float(np.sum(np.asarray(graph.length, float))), tuple(faults))


def _one_sided(found: RoadMap) -> list[MapFault]:
    """Links that only one of their two lanes states, in formats where both do."""
    lanes, out = {lane.id: lane for lane in found.lanes}, []
    for lane in found.lanes:
        if lane.predecessors is None:
            continue
        for other in lane.successors:
            if other in lanes and lane.id not in (lanes[other].predecessors or ()):
                out.append(MapFault("one-sided link", lane.id, f"its successor {other!r} has it as no predecessor"))
        for other in lane.predecessors:
            if other in lanes and lane.id not in lanes[other].successors:
                out.append(MapFault("one-sided link", lane.id, f"its predecessor {other!r} has it as no successor"))
        for side, back in (("left", "right"), ("right", "left")):
            other = getattr(lane, f"{side}_id")
            if other in lanes and getattr(lanes[other], f"{back}_id") != lane.id:
                out.append(MapFault("one-sided link", lane.id, f"its {side} neighbour {other!r} does not name it"))
    return out


def _dead(found: RoadMap) -> list[MapFault]:
    """Lanes that end or begin inside the map, without a neighbour that goes on."""
    graph = found.graph
    centre = np.asarray(graph.centre, float)
    points = centre[:, [0, -1]].reshape(-1, 2)
    size = float(np.ptp(points, axis=0).max())
    try:
        hull = ConvexHull(centre.reshape(-1, 2)).equations
    except QhullError:  # all on one line
        return []
    inside = -(points @ hull[:, :2].T + hull[:, 2]).max(1).reshape(-1, 2) > max(EDGE, size / 20)
    out = []
    for k, kind, mask, what in (
        (1, "dead end", graph.has_successor, "no successor"),
        (0, "dead start", graph.has_predecessor, "no predecessor"),
    ):
        has: Any = np.asarray(mask).any(1)
        beside = [np.asarray(getattr(graph, f"has_{side}")) for side in ("left", "right")]
        goes_on = np.logical_or(beside[0] & has[graph.left_link], beside[1] & has[graph.right_link])
        for i in np.flatnonzero(inside[:, k] & ~has & ~goes_on):
            out.append(MapFault(kind, found.ids[i], f"{what}, though inside the map"))
    return out


def _borders(found: RoadMap) -> list[MapFault]:
    """Lanes whose borders cross themselves or each other, or lie on the wrong sides."""
    out = []
    for lane in found.lanes:
        left, right = (_thinned(border) for border in (lane.left, lane.right))
        if not lane.drawn:  # borders made from a centre line cross in every tight turn
            left = right = _thinned(0.5 * (lane.left + lane.right))
        if crossing(left[None], left[None])[0] or crossing(right[None], right[None])[0]:
            what = "a border" if lane.drawn else "its centre line"
            out.append(MapFault("self-overlap", lane.id, f"{what} crosses itself"))
        elif crossing(left[None], right[None])[0]:
            out.append(MapFault("self-overlap", lane.id, "its borders cross each other"))
        elif _swapped(lane):
            out.append(MapFault("swapped borders", lane.id, "its left border lies on the right"))
    return out


def _thinned(points: np.ndarray) -> np.ndarray:
    """At most CORNERS points of a polyline [n, 2]."""
    if len(points) <= CORNERS:
        return points
    return points[np.linspace(0, len(points) - 1, CORNERS).astype(int)]


def _swapped(lane: MapLane) -> bool:
    middle = _thinned(lane.left)
    return bool(stations(lane.right)[-1] > 0 and project(middle, _thinned(lane.right))[2].mean() < -1e-6)


def _twice(found: RoadMap) -> list[MapFault]:
    """Links whose centre lines are the same."""
    centre = np.asarray(found.graph.centre)
    last = centre.shape[1] - 1
    seen: dict[bytes, int] = {}
    out = []
    for i, row in enumerate(np.round(centre[:, [0, last // 2, last]], 2)):
        first = seen.setdefault(row.tobytes(), i)
        if first != i:
            out.append(MapFault("twice", found.ids[i], f"lies on lane {found.ids[first]!r}"))
    return out
