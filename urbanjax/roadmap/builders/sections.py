"""Lanes side by side along a reference line (host side)."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from urbanjax.roadmap.builders.curves import Curve, normal
from urbanjax.roadmap.builders.specs import LaneSpec
from urbanjax.types import RoadError


def corridor(
    name: str,
    line: Curve,
    *,
    breaks: Sequence[float] | np.ndarray,
    n_lanes: Sequence[int],
    lane_width: float = 3.5,
    closed: bool = False,
    sections: Mapping[int, Mapping[str, Any]] | None = None,
    **common: Any,
) -> list[LaneSpec]:
    """Lanes to the right of `line`, cut into sections; lane 0 is the leftmost and touches the line.

    Keys are (name, section, lane). A lane that the next section does not have ends without a successor; one that the
    section before does not have starts without a predecessor. Order: section by section, lanes from left to right.
    Args: name, first part of the keys; line, left edge of the lanes; breaks m, stations of the section borders (one
    more than sections); n_lanes, number of lanes in each section; lane_width m; closed, the last section leads to the
    first; sections, LaneSpec fields of single sections; common, LaneSpec fields of all.
    """
    check_sizes(lane_width=lane_width)
    if len(breaks) != len(n_lanes) + 1 or min(n_lanes, default=0) < 1 or np.any(np.diff(breaks) <= 0):
        raise RoadError(
            f"corridor {name!r}: breaks must rise, with one more of them than sections, each of 1 lane or more"
        )
    specs = []
    for k, count in enumerate(n_lanes):
        part = line.cut(breaks[k], breaks[k + 1])
        after = (k + 1) % len(n_lanes) if closed or k + 1 < len(n_lanes) else None
        for q in range(count):
            going_on = after is not None and q < n_lanes[after]
            fields = {
                "left": (name, k, q - 1) if q > 0 else None,
                "right": (name, k, q + 1) if q + 1 < count else None,
                "successors": ((name, after, q),) if going_on else (),
                "width": lane_width,
                **common,
                **((sections or {}).get(k) or {}),
            }
            centre = part.position - (q + 0.5) * lane_width * normal(part.heading)
            specs.append(LaneSpec((name, k, q), centre, part.heading, **fields))
    return specs


def evenly(length: float, section: float) -> np.ndarray:
    """Section borders [m] that cut `length` into equal parts of at most `section`. Args: length m; section m."""
    check_sizes(length=length, section=section)
    # A length that is a multiple of the section but for rounding gets no further section.
    return np.linspace(0.0, length, max(int(np.ceil(length / section - 1e-9)), 1) + 1)


def check_sizes(**sizes: float) -> None:
    """Raises RoadError unless every size is a positive finite number. Args: sizes by name."""
    for name, value in sizes.items():
        if not (np.isfinite(value) and value > 0):
            raise RoadError(f"{name} is {value}: it must be positive and finite")
