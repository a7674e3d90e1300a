"""Whether a drive reaches what a planning problem asks for (host side)."""

import jax.numpy as jnp
import numpy as np

from urbanjax.evaluation.recorded.planning_problem import Goal, Region
from urbanjax.evaluation.recorded.scenes import EgoStart
from urbanjax.geometry.boxes import box, corners
from urbanjax.roadmap.graph import RoadGraph

ROUNDING = 1e-6  # s or m/s, by which a bound may be missed
DISC = 32  # corners of the polygon that stands for a disc


def reached(start: EgoStart, graph: RoadGraph, *, path: np.ndarray, speed: np.ndarray, period: float) -> bool:
    """Whether some goal holds in some step: its time, place, speed and heading, as far as it names them.

    Args: start, with the goals; graph, the road graph; path [T, 3] x, y (m), heading (rad) of the box centre; speed [T]
    m/s; period [s]; host arrays.
    """
    time = (start.first + np.arange(len(path))) * period
    return any(bool(_holds(goal, graph, path, speed, time).any()) for goal in start.goals)


def _holds(goal: Goal, graph: RoadGraph, path: np.ndarray, speed: np.ndarray, time: np.ndarray) -> np.ndarray:
    """In which steps [T] one goal holds."""
    there = np.ones(len(path), bool)
    for bounds, values in ((goal.time, time), (goal.speed, speed)):
        if bounds is not None:
            there &= (values >= bounds[0] - ROUNDING) & (values <= bounds[1] + ROUNDING)
    if goal.heading is not None:
        low, high = goal.heading
        there &= (path[:, 2] - low) % (2 * np.pi) <= high - low
    if goal.links or goal.regions:
        outlines = [np.concatenate([graph.left[link], np.asarray(graph.right[link])[::-1]]) for link in goal.links]
        outlines += [_outline(region) for region in goal.regions]
        there &= np.any([_inside(outline, path[:, :2]) for outline in outlines], axis=0)
    return there


def _inside(outline: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Which points [n, 2] lie in a polygon [m, 2]: a ray from them crosses its border an odd number of times."""
    start, end = np.asarray(outline, float), np.roll(np.asarray(outline, float), -1, axis=0)
    x, y = points[:, :1], points[:, 1:]
    spans = (start[:, 1] > y) != (end[:, 1] > y)
    rise = np.where(end[:, 1] == start[:, 1], 1.0, end[:, 1] - start[:, 1])
    crossing = start[:, 0] + (y - start[:, 1]) * (end[:, 0] - start[:, 0]) / rise
    return (spans & (x < crossing)).sum(1) % 2 == 1


def _outline(region: Region) -> np.ndarray:
    """The corners [n, 2] (m) of a region; 32 of a disc."""
    centre = np.asarray(region.centre, float)
    if region.corners is not None:
        return np.asarray(region.corners, float)
    if region.radius:
        angle = np.arange(DISC) * (2 * np.pi / DISC)
        return centre + region.radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    place = (jnp.asarray(x, float) for x in (centre, region.heading, region.length, region.width))
    at, heading, length, width = place
    return np.asarray(corners(box(at, heading, length=length, width=width)))
