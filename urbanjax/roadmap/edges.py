"""The edges of the road: the borders and ends of lanes beyond which there is no other lane, and the distance to them.

What no lane covers is found once per map (host side, float64), so that a look-up is a few segments near a place.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int

from urbanjax.numerics import lean, safe
from urbanjax.roadmap.graph import RoadGraph

PARTS = 8  # of a link, each with a list of edges of its own
NEAREST = 64  # edges in such a list
SEAM = 0.05  # m, a gap between lanes up to which the road goes on
BRIDGE = 1.0  # m, a gap between a lane and the next one up to which the road goes on
SAGITTA = 0.01  # m, by which an edge may cut a bend
LONGEST = 12.0  # m, of an edge, where the map's points permit
SHORTEST = 0.01  # m, of what is left of one
JOINT = 0.15  # m, between the ends of edges that follow each other
TIE = 1.00001  # times the least squared distance: as near
LEAST = 1.0  # m, of edges in a row: a hole with less around it is none
X, Y, STEP_X, STEP_Y, START_X, START_Y, END_X, END_Y = range(8)  # columns: start, step, and normals at both ends


def road_edges(graph: RoadGraph) -> Float[Array, "n k 8"]:
    """For each part of each link (`PARTS` of them) the K edges nearest to it, the road on their left.

    Done once, outside jit. Columns: start and step of each edge (m), and what tells the road's side of its two ends:
    directions [-] that point to the road from there.
    Args: graph, the road graph.
    """
    found = _columns(*_uncovered(*_outline(graph)))
    return jnp.asarray(_nearest(graph, found), graph.centre.dtype)


def edge_rows(edges: Float[Array, "n k 8"], link: Int[Array, ""], *, share: Float[Array, ""]) -> Float[Array, "k 8"]:
    """The edges near a place on a link. Args: edges, of `road_edges`; link; share [-], of its length, in [0, 1]."""
    part = jnp.clip(jnp.floor(share * PARTS), 0, PARTS - 1).astype(jnp.int32)
    return lean.rows(edges, link * PARTS + part)


def edge_distance(rows: Float[Array, "k 8"], points: Float[Array, "m 2"]) -> Float[Array, "m"]:
    """Distance of each point [m] to the nearest edge, positive on the road and negative off it.

    Args: rows, the edges near the points; points [M, 2] m.
    """
    x, y = (points[None, :, i] - rows[:, i, None] for i in (X, Y))
    dx, dy = rows[:, STEP_X, None], rows[:, STEP_Y, None]
    t = jnp.clip((x * dx + y * dy) * (1 / (dx * dx + dy * dy)), 0.0, 1.0)
    square = (x - t * dx) ** 2 + (y - t * dy) ** 2
    # The first of the smallest, up to rounding; `argmin` would take several times as long on a CPU.
    last = rows.shape[0] - 1
    each = jax.lax.broadcasted_iota(jnp.int32, square.shape, 0)
    k = jnp.min(jnp.where(square <= TIE * jnp.min(square, axis=0)[None, :], each, last), axis=0)
    row = lean.rows(rows, k)
    away, step = points - row[:, X : Y + 1], row[:, STEP_X : STEP_Y + 1]
    along = jnp.sum(away * step, axis=1) / jnp.sum(step * step, axis=1)
    lateral = (step[:, 0] * away[:, 1] - step[:, 1] * away[:, 0]) / safe.norm(step)
    before, beyond = along < 0, along > 1
    corner = jnp.where(beyond[:, None], away - step, away)
    towards = jnp.where(beyond[:, None], row[:, END_X : END_Y + 1], row[:, START_X : START_Y + 1])
    at_corner = jnp.where(jnp.sum(corner * towards, axis=1) < 0, -1.0, 1.0) * safe.norm(corner)
    return jnp.where(before | beyond, at_corner, lateral)


def _outline(graph: RoadGraph) -> tuple[np.ndarray, np.ndarray]:
    """The sides of all lanes [N, 2, 2] m, the lane on their left, and the triangles [M, 3, 2] m that lanes consist of.

    Of the points of a lane only as many are kept as its shape asks for. A gap before the next lane is bridged.
    """
    valid = np.asarray(graph.valid)
    borders = np.stack([np.asarray(x, float) for x in (graph.left, graph.right)], axis=1)
    link, branch = np.nonzero(np.asarray(graph.has_successor) & valid[:, None])
    bridges = np.stack([borders[link, :, -1], borders[np.asarray(graph.successor)[link, branch], :, 0]], axis=2)
    strips = [bridges[np.linalg.norm(bridges[:, :, 1] - bridges[:, :, 0], axis=-1).max(1) < BRIDGE]]
    borders, last, done = borders[valid], borders.shape[2] - 1, np.zeros(valid.sum(), bool)
    fewest = np.ceil(np.asarray(graph.length, float)[valid] / LONGEST)
    for pieces in sorted({min(2**i, last) for i in range(last.bit_length() + 1)}):
        knots = np.round(np.linspace(0, last, pieces + 1)).astype(int)
        fits = (pieces >= fewest) & (_sagitta(borders, knots) < SAGITTA) if pieces < last else np.ones_like(done)
        strips.append(borders[fits & ~done][:, :, knots])
        done |= fits
    sides, triangles = [], []
    for left, right in (np.moveaxis(strip, 1, 0) for strip in strips):
        ends = [(left[:, :1], right[:, :1]), (right[:, -1:], left[:, -1:])]
        for a, b in [(right[:, :-1], right[:, 1:]), (left[:, 1:], left[:, :-1]), *ends]:
            sides.append(np.stack([a, b], axis=2).reshape(-1, 2, 2))
        for corners in ((left[:, :-1], right[:, :-1], right[:, 1:]), (left[:, :-1], right[:, 1:], left[:, 1:])):
            triangles.append(np.stack(corners, axis=2).reshape(-1, 3, 2))
    sides, triangles = np.concatenate(sides), np.concatenate(triangles)
    return sides[np.linalg.norm(sides[:, 1] - sides[:, 0], axis=1) > SHORTEST], triangles


def _sagitta(borders: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """How far [L] m the points of borders [L, 2, P, 2] lie off the chords between the knots."""
    index = np.arange(knots[-1] + 1)
    k = np.clip(np.searchsorted(knots, index, side="right") - 1, 0, len(knots) - 2)
    start, chord = borders[:, :, knots[k]], borders[:, :, knots[k + 1]] - borders[:, :, knots[k]]
    away = borders - start
    share = np.clip((away * chord).sum(-1) / np.maximum((chord * chord).sum(-1), 1e-12), 0, 1)
    return np.linalg.norm(away - share[..., None] * chord, axis=-1).max((1, 2))


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _left_of(step: np.ndarray) -> np.ndarray:
    """Unit vectors to the left of steps [N, 2]."""
    return np.stack([-step[:, 1], step[:, 0]], axis=1) / np.linalg.norm(step, axis=1, keepdims=True)


def _uncovered(sides: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Start and end [E, 2] m of the parts of sides [N, 2, 2] that no triangle [M, 3, 2] covers `SEAM` beyond them."""
    start, step = sides[:, 0], sides[:, 1] - sides[:, 0]
    side, triangle = _close(sides, triangles)
    corner = triangles[triangle]
    turn = np.sign(_cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]))
    first = (start - SEAM * _left_of(step))[side]
    low, high = np.zeros(len(side)), np.ones(len(side))
    for i in range(3):  # the part of each side within each half-plane of the triangle
        a, edge = corner[:, i], corner[:, (i + 1) % 3] - corner[:, i]
        depth, slope = turn * _cross(edge, first - a), turn * _cross(edge, step[side])
        root = -depth / np.where(slope == 0, 1.0, slope)
        low = np.where(slope > 0, np.maximum(low, root), low)
        high = np.where(slope < 0, np.minimum(high, root), high)
        high = np.where((slope == 0) & (depth <= 0), -1.0, high)
    covers = high > low
    # All sides on one axis, each from its number to the next: what is left between intervals, sorted by their start.
    ends = np.arange(len(sides) + 1.0)
    begins = np.concatenate([side[covers] + low[covers], ends])
    until = np.concatenate([side[covers] + high[covers], ends])
    order = np.argsort(begins, kind="stable")
    begins, until = begins[order][1:], np.maximum.accumulate(until[order])[:-1]
    row = np.minimum(until.astype(int), len(sides) - 1)
    free = (begins - until) * np.linalg.norm(step, axis=1)[row] > SHORTEST
    row, t0, t1 = row[free], until[free], begins[free]
    return start[row] + (t0 - row)[:, None] * step[row], start[row] + (t1 - row)[:, None] * step[row]


def _close(sides: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All pairs of a side and a triangle whose bounding boxes come within `SEAM`."""
    from scipy.spatial import cKDTree  # here: importing the package is not to wait for it

    low, high = triangles.min(1) - SEAM, triangles.max(1) + SEAM
    reach = np.linalg.norm(high - low, axis=1).max() / 2 + np.linalg.norm(sides[:, 1] - sides[:, 0], axis=1) / 2
    near = cKDTree((low + high) / 2).query_ball_point(sides.mean(1), reach)
    side = np.repeat(np.arange(len(sides)), [len(row) for row in near])
    triangle = np.concatenate(near).astype(int)
    meet = (sides.min(1)[side] <= high[triangle]) & (sides.max(1)[side] >= low[triangle])
    keep = meet.all(1)
    return side[keep], triangle[keep]


def _columns(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """[E, 8] from the ends [E, 2] m of all edges, those around specks left out.

    From a corner of two edges the road is where the sum of their normals points. Beyond an edge that none follows, the
    gap between two lanes has closed.
    """
    from scipy.sparse import coo_array  # here: importing the package is not to wait for it
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    step, number = end - start, np.arange(len(start))
    length = np.linalg.norm(step, axis=1)
    normal, onwards = _left_of(step), step / length[:, None]
    (away, after), (back, before) = cKDTree(start).query(end), cKDTree(end).query(start)
    row = coo_array((away < JOINT, (number, after)), shape=(len(start),) * 2)
    chain = connected_components(row, directed=False)[1]
    keep = np.bincount(chain, length)[chain] > LEAST

    def towards(other: np.ndarray, gap: np.ndarray, beyond: np.ndarray) -> np.ndarray:
        # Opposite normals cancel out where a gap ends in a point.
        return np.where((gap < JOINT)[:, None], normal + normal[other] + 1e-3 * beyond, beyond)

    return np.concatenate([start, step, towards(before, back, -onwards), towards(after, away, onwards)], axis=1)[keep]


def _nearest(graph: RoadGraph, found: np.ndarray) -> np.ndarray:
    """[L * PARTS, K, 8] the edges nearest to the middle of each part of each link."""
    from scipy.spatial import cKDTree  # here: importing the package is not to wait for it

    centre = np.asarray(graph.centre, float)
    where = (np.arange(PARTS) + 0.5) / PARTS * (centre.shape[1] - 1)
    k = where.astype(int)
    share = (where - k)[:, None]
    middle = (centre[:, k] * (1 - share) + centre[:, k + 1] * share).reshape(-1, 2)
    distance, index = cKDTree(found[:, :2] + found[:, 2:4] / 2).query(middle, k=2 * NEAREST)
    index = np.minimum(index, len(found) - 1)  # of a road with fewer edges the last one is repeated
    order = np.argsort(distance - np.linalg.norm(found[index, 2:4], axis=-1) / 2, axis=1)[:, :NEAREST]
    return found[np.take_along_axis(index, order, axis=1)]
