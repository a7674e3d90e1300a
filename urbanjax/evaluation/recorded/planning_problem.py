"""Driving tasks among recorded traffic, as CommonRoad states them (host side, relative to the graph's origin)."""

from collections.abc import Hashable

import numpy as np

from urbanjax.types import host_record


@host_record
class Region:
    """A goal region: a box, a disc (where `radius` is set) or a polygon (where `corners` is)."""

    centre: tuple[float, float]  # m, relative to the graph's origin
    heading: float = 0.0  # rad
    length: float = 0.0  # m
    width: float = 0.0  # m
    radius: float = 0.0  # m
    corners: np.ndarray | None = None  # [n, 2] m, relative to the graph's origin


@host_record
class Goal:
    """What a planning problem asks for; None where it asks for nothing."""

    lanes: tuple[Hashable, ...] = ()  # any of them
    links: tuple[int, ...] = ()  # those of them that are links of the graph
    regions: tuple[Region, ...] = ()  # any of them
    time: tuple[float, float] | None = None  # s
    speed: tuple[float, float] | None = None  # m/s
    heading: tuple[float, float] | None = None  # rad


@host_record
class PlanningProblem:
    """A start and the goals, any of which may be reached."""

    id: Hashable
    position: tuple[float, float]  # m, of the ego's centre, relative to the graph's origin
    heading: float  # rad
    speed: float  # m/s
    time: float  # s
    goals: tuple[Goal, ...]
