"""Whether a drive reaches what a planning problem asks for (host side)."""

import numpy as np

from urbanjax.io.maps import Goal, Region
from urbanjax.io.studies.recorded.scenes import Start
from urbanjax.roadmap.graph import RoadGraph


def reached(start: Start, graph: RoadGraph, path: np.ndarray, speed: np.ndarray, period: float) -> bool:
    """Whether some goal holds in some step: its time, place, speed and heading, as far as it names them.

    Args: path [T, 3] x, y (m), heading (rad) of the box centre; speed [T] m/s; period s.
    """
    time = (start.first + np.arange(len(path))) * period
    return any(bool(_holds(goal, graph, path, speed, time).any()) for goal in start.goals)


def _holds(goal: Goal, graph: RoadGraph, path: np.ndarray, speed: np.ndarray, time: np.ndarray) -> np.ndarray:
    """In which steps [T] one goal holds."""
    there = np.ones(len(path), bool)
    for bounds, values in ((goal.time, time), (goal.speed, speed)):
        if bounds is not None:
            there &= (values >= bounds[0] - 1e-6) & (values <= bounds[1] + 1e-6)
    if goal.heading is not None:
        low, high = goal.heading
        there &= (path[:, 2] - low) % (2 * np.pi) <= high - low
    if goal.links or goal.regions:
        outlines = [np.concatenate([graph.left[link], np.asarray(graph.right[link])[::-1]]) for link in goal.links]
        outlines += [_outline(region) for region in goal.regions]
        there &= np.any([_inside(outline, path[:, :2]) for outline in outlines], axis=0)
    return there


def _outline(region: Region) -> np.ndarray:
    """The corners [n, 2] (m) of a region; 32 of a disc."""
    centre = np.asarray(region.centre, float)
    if region.corners is not None:
        return np.asarray(region.corners, float)
    if region.radius:
        angle = np.arange(32) * (2 * np.pi / 32)
        return centre + region.radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    cos, sin = np.cos(region.heading), np.sin(region.heading)
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * [region.length / 2, region.width / 2]
    return centre + corners @ np.array([[cos, sin], [-sin, cos]])


def _inside(outline: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Which points [n, 2] lie within a polygon [m, 2], by the number of its sides to their right."""
    a, b = outline, np.roll(outline, -1, axis=0)
    x, y = points[:, 0, None], points[:, 1, None]
    crosses = (a[None, :, 1] > y) != (b[None, :, 1] > y)
    rise = np.where(b[:, 1] == a[:, 1], 1.0, b[:, 1] - a[:, 1])
    at = a[None, :, 0] + (y - a[None, :, 1]) * ((b - a)[None, :, 0] / rise[None])
    return (crosses & (x < at)).sum(axis=1) % 2 == 1
