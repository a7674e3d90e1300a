"""Polylines: stations, headings, curvatures, interpolation, and the exact projection of a point.

Points may repeat (a padded polyline repeats its last point): a segment of length zero has no say in anything. With a
mask over the points, a segment counts if both of its ends do. Batches go through vmap.
"""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.numerics import lean, safe
from urbanjax.types import pytree


@pytree
class Projection:
    """The nearest point of a polyline to a query."""

    station: Array  # [] m along the polyline
    offset: Array  # [] m, left of the polyline positive
    heading: Array  # [] rad, interpolated between the vertices, so continuous along the polyline
    curvature: Array  # [] 1/m, likewise
    position: Array  # [2] m, the nearest point
    distance: Array  # [] m, to the nearest point
    segment: Array  # [] int32, index of the first vertex of the nearest segment
    fraction: Array  # [] in [0, 1], along that segment


@pytree
class _Segments:
    """The segments of a polyline, and for each vertex the ones beside it that count (itself, where there is none)."""

    step: Array  # [P-1, 2] m
    length: Array  # [P-1] m
    counts: Array  # [P-1] bool
    before: Array  # [P] int32, last counting segment before the vertex
    after: Array  # [P] int32, first counting segment after it
    has_before: Array  # [P] bool
    has_after: Array  # [P] bool


def _segments(points: Array, mask: Array | None) -> _Segments:
    step = points[1:] - points[:-1]
    length = safe.norm(step)
    counts = length > 0 if mask is None else (length > 0) & mask[1:] & mask[:-1]
    n = counts.shape[0]
    index = jnp.arange(n)
    before = jnp.pad(jax.lax.cummax(jnp.where(counts, index, -1)), (1, 0), constant_values=-1)
    after = jnp.pad(jax.lax.cummin(jnp.where(counts, index, n), reverse=True), (0, 1), constant_values=n)
    return _Segments(
        step,
        length,
        counts,
        jnp.maximum(before, 0),
        jnp.minimum(after, n - 1),
        has_before=before >= 0,
        has_after=after < n,
    )


def arc_length(points: Float[Array, "p 2"], mask: Bool[Array, "p"] | None = None) -> Float[Array, "p"]:
    """Station [m] of each point: cumulative chord length from the first (Eq. 19).

    Args: points [P, 2] m; mask [P], points that count.
    """
    segments = _segments(points, mask)
    return jnp.pad(jnp.cumsum(jnp.where(segments.counts, segments.length, 0)), (1, 0))


def headings(points: Float[Array, "p 2"], mask: Bool[Array, "p"] | None = None) -> Float[Array, "p"]:
    """Heading [rad] of the curve through the points at each of them, unwrapped along the polyline.

    Two segments share the turn between them by their lengths, and each end mirrors its neighbour in the chord: exact
    on a circle. Repeated points share one heading. A polyline without a segment has heading 0.
    Args: points [P, 2] m; mask [P], points that count.
    """
    g = _segments(points, mask)
    direction = safe.arctan2(g.step[:, 1], g.step[:, 0])
    inside = g.has_before & g.has_after
    turn = jnp.where(inside, safe.wrap_angle(direction[g.after] - direction[g.before]), 0)
    first_of_repeated = jnp.pad(g.counts, (1, 0))
    start = jnp.where(jnp.any(g.counts), direction[g.after[0]], 0)
    ahead = start + jnp.cumsum(jnp.where(first_of_repeated, turn, 0))  # of the segment after the vertex
    inner = ahead - turn * safe.divide(g.length[g.after], g.length[g.before] + g.length[g.after])
    mirrored = jnp.where(g.has_before, 2 * ahead - inner[g.before[-1]], 2 * ahead - inner[g.after[0] + 1])
    return jnp.where(inside, inner, mirrored)


def curvatures(points: Float[Array, "p 2"], mask: Bool[Array, "p"] | None = None) -> Float[Array, "p"]:
    """Signed curvature [1/m] at each point, left positive: of the circle through it and its two neighbours.

    An end takes the value of its neighbour; a straight line, a reversal or a polyline of one segment has curvature 0.
    Args: points [P, 2] m; mask [P], points that count.
    """
    g = _segments(points, mask)
    a, b = g.step[g.before], g.step[g.after]
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    inner = safe.divide(2 * cross, g.length[g.before] * g.length[g.after] * safe.norm(a + b))
    inner = jnp.where(g.has_before & g.has_after, inner, 0)
    inner = jnp.where(g.has_before, inner, inner[g.after[0] + 1])
    return jnp.where(g.has_after, inner, inner[g.before[-1]])


def interpolate(
    grid: Float[Array, "n"], values: Float[Array, "n *c"], *, query: Float[Array, "*q"]
) -> Float[Array, "..."]:
    """Values [*q, *c] at the queries, linear between the grid's entries and constant beyond its ends.

    Args: grid [n], not decreasing (where it repeats, the last value counts); values [n, *c]; query [*q].
    """
    index = jnp.searchsorted(grid, query, side="right", method="compare_all") - 1
    index = lean.clip(index, 0, grid.shape[0] - 2)
    start, end = lean.rows(grid, index), lean.rows(grid, index + 1)
    fraction = lean.clip(safe.divide(query - start, end - start), 0.0, 1.0)
    fraction = fraction.reshape(fraction.shape + (1,) * (values.ndim - 1))
    return lean.rows(values, index) * (1 - fraction) + lean.rows(values, index + 1) * fraction


def resample(points: Float[Array, "p 2"], n: int, *, mask: Bool[Array, "p"] | None = None) -> Float[Array, "{n} 2"]:
    """The polyline's points [n, 2] at n equal steps of arc length, its two ends included.

    Args: points [P, 2] m; n, number of points; mask [P], points that count.
    """
    station = arc_length(points, mask)
    return interpolate(station, points, query=station[-1] * jnp.linspace(0, 1, n, dtype=points.dtype))


def _nearest(points: Array, query: Array, counts: Array) -> Array:
    """Index of the counting segment nearest to the query, the first one on a tie."""
    dx, dy = points[1:, 0] - points[:-1, 0], points[1:, 1] - points[:-1, 1]
    x, y = query[0] - points[:-1, 0], query[1] - points[:-1, 1]
    fraction = jnp.clip(safe.divide(x * dx + y * dy, dx * dx + dy * dy), 0, 1)
    miss = (x - fraction * dx) ** 2 + (y - fraction * dy) ** 2
    return jnp.argmin(jnp.where(counts, miss, jnp.inf))


def project(
    points: Float[Array, "p 2"],
    query: Float[Array, "2"],
    *,
    mask: Bool[Array, "p"] | None = None,
    station: Float[Array, "p"] | None = None,
    heading: Float[Array, "p"] | None = None,
    curvature: Float[Array, "p"] | None = None,
) -> Projection:
    """The exact nearest point of the polyline to the query, with signed offset and interpolated heading.

    Station, offset, heading and position are continuous in the query wherever the nearest point is unique (across
    vertices and past the ends too). Not differentiable on the two normals of each vertex: on the convex side, where the
    vertex itself is nearest, the station rests. Past an end the offset is the lateral part and `distance` all of it.
    Args: points [P, 2] m; query [2] m; mask [P], points that count (with no segment at all, the first point is the
    answer and the offset is 0); station [P] m, heading [P] rad, unwrapped, and curvature [P] 1/m of the vertices,
    computed here if not given.
    """
    counts = _segments(points, mask).counts
    station = arc_length(points, mask) if station is None else station
    heading = headings(points, mask) if heading is None else heading
    curvature = curvatures(points, mask) if curvature is None else curvature
    i = jax.lax.stop_gradient(_nearest(points, query, counts))

    step = points[i + 1] - points[i]
    along = safe.divide(jnp.vdot(query - points[i], step), jnp.vdot(step, step))
    fraction = jnp.clip(along, 0, 1)
    position = points[i] + fraction * step
    miss = query - position
    distance = safe.norm(miss)
    angle = _mix(heading, i, fraction)

    lateral = safe.divide(step[0] * miss[1] - step[1] * miss[0], safe.norm(step))
    left = jnp.cos(angle) * miss[1] - jnp.sin(angle) * miss[0] >= 0
    index = jnp.arange(counts.shape[0])
    at_vertex = ((along < 0) & jnp.any(counts & (index < i))) | ((along > 1) & jnp.any(counts & (index > i)))
    return Projection(
        station=_mix(station, i, fraction),
        offset=jnp.where(at_vertex, jnp.where(left, distance, -distance), lateral),
        heading=angle,
        curvature=_mix(curvature, i, fraction),
        position=position,
        distance=distance,
        segment=i,
        fraction=fraction,
    )


def _mix(values: Array, i: Array, fraction: Array) -> Array:
    return values[i] * (1 - fraction) + values[i + 1] * fraction
