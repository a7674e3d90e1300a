"""Rectangles on the ground: how far from the lanes, and which are in each other's way (host side)."""

import jax
import numpy as np

from urbanjax.geometry.boxes import box, overlap
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.types import as_arrays

SPACING = 0.5  # m, between two points of a border
PERIMETER = 1.0  # m, between two points of a footprint's outline
COARSE = 0.15  # m, by which distances between such points may be too large
LARGE = 4.0  # m, half a diagonal

_box, _overlaps = jax.jit(box), jax.jit(overlap)


def clearance(graph: RoadGraph, centre: np.ndarray, *, heading: np.ndarray, half: np.ndarray) -> np.ndarray:
    """[K] m, how far rectangles are from all lanes, at least; 0 and little more where they lie on one.

    Taken between points of outlines and of centre lines and borders, which lie closer than a metre to any point of a
    lane: a clearance of at least 1 m is right, a smaller one means too close. Args: graph, the road graph; centre [K,
    2] m; heading [K] rad; half [K, 2] m, half of length and width; host arrays.
    """
    from scipy.spatial import cKDTree  # here: importing the package is not to wait for it

    lines = np.concatenate([np.asarray(line, float)[np.asarray(graph.valid)] for line in _lines(graph)])
    n = int(np.ceil(np.linalg.norm(np.diff(lines, axis=1), axis=-1).max() / SPACING))
    share = (np.arange(n) / n)[:, None]
    dense = lines[:, :-1, None] * (1 - share) + lines[:, 1:, None] * share
    tree = cKDTree(np.concatenate([dense.reshape(-1, 2), lines[:, -1]]))
    points, owner = outline(centre, heading, half=half)
    distance, _ = tree.query(points)
    nearest = np.full(len(centre), np.inf)
    np.minimum.at(nearest, owner, distance)
    return np.maximum(nearest - COARSE, 0.0)


def _lines(graph: RoadGraph) -> tuple:
    return graph.left, graph.centre, graph.right


def outline(centre: np.ndarray, heading: np.ndarray, *, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points [M, 2] on the outlines of rectangles, at most `PERIMETER` apart, and whose each is [M].

    Args: centre [K, 2] m; heading [K] rad; half [K, 2] m, half of length and width; host arrays.
    """
    along, across = np.array([-1, 1, 1, -1]), np.array([-1, -1, 1, 1])
    corner = np.stack([half[:, :1] * along, half[:, 1:] * across], axis=-1)
    n = np.ceil(2 * half[:, [0, 1, 0, 1]] / PERIMETER).astype(int).reshape(-1)
    side = np.repeat(np.arange(len(n)), n)
    share = ((np.arange(len(side)) - np.repeat(np.cumsum(n) - n, n)) / n[side])[:, None]
    start, end = corner.reshape(-1, 2), np.roll(corner, -1, axis=1).reshape(-1, 2)
    local, owner = start[side] * (1 - share) + end[side] * share, side // 4
    cos, sin = np.cos(heading[owner]), np.sin(heading[owner])
    turned = np.stack([cos * local[:, 0] - sin * local[:, 1], sin * local[:, 0] + cos * local[:, 1]], axis=-1)
    return centre[owner] + turned, owner


def apart(
    rows: dict[str, np.ndarray], rank: np.ndarray, *, holder: np.ndarray, kept: np.ndarray, spared: int
) -> np.ndarray:
    """[K] which stay when of two that overlap, in plan and in height, the one of higher rank goes, and all it holds.

    Args: rows, the fields of `Scenery`; rank [K]; holder [K], what each is fixed to (itself: nothing); kept [K] bool,
    those in question; spared, a rank whose members may overlap each other.
    """
    size = np.linalg.norm(rows["half"], axis=1)
    first, second = _near(rows["centre"], size)
    other = (holder[first] != holder[second]) & ((rank[first] != spared) | (rank[second] != spared))
    first, second = first[other], second[other]
    high = (rows["bottom"][first] < rows["top"][second]) & (rows["bottom"][second] < rows["top"][first])
    first, second = first[high], second[high]
    clash = _overlap(rows, first, second)
    first, second = first[clash], second[clash]
    kept = kept.copy()
    order = np.lexsort((np.arange(len(rank)), rank))
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    before, after = np.where(place[first] < place[second], (first, second), (second, first))
    for k in np.argsort(place[before], kind="stable"):
        if kept[before[k]] and kept[holder[before[k]]]:
            kept[after[k]] = False
    return kept & kept[holder]


def _near(centre: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of circles that overlap: small ones among each other, and every large one with all."""
    from scipy.spatial import cKDTree  # here: importing the package is not to wait for it

    large = size > LARGE
    reach = size.max(initial=0.0)
    pairs = [cKDTree(centre[~large]).query_pairs(2 * LARGE, output_type="ndarray")] if (~large).any() else []
    pairs = [np.flatnonzero(~large)[pair] for pair in pairs]
    tree = cKDTree(centre)
    for k in np.flatnonzero(large):
        near = np.array(tree.query_ball_point(centre[k], size[k] + reach), int)
        pairs.append(np.stack([np.full(len(near), k), near], axis=1))
    first, second = np.concatenate(pairs).T
    touching = np.linalg.norm(centre[first] - centre[second], axis=1) < size[first] + size[second]
    return first[touching & (first != second)], second[touching & (first != second)]


def _overlap(rows: dict[str, np.ndarray], first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """[M] whether pairs of rectangles overlap (no separating axis)."""
    centre, heading, size = rows["centre"], rows["heading"], 2 * rows["half"]
    rectangles = as_arrays([(centre[k], heading[k], size[k, 0], size[k, 1]) for k in (first, second)])
    one, other = (_box(at, angle, length=length, width=width) for at, angle, length, width in rectangles)
    return np.asarray(_overlaps(one, other))
