"""Twice continuously differentiable cubic splines over arc length (Eq. 19-21).

Erratum of Eq. 20-21: the printed argument s - s_g is not local to a knot; here every interval has its own cubic in the
distance from its knot. A knot that repeats the station of the one before it (a segment of length zero) is passed over.
Batches go through vmap.
"""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.geometry import polyline
from urbanjax.numerics import safe
from urbanjax.types import pytree


@pytree
class Spline:
    """K knots of C channels; between two knots a cubic with the second derivative linear."""

    station: Array  # [K] m, not decreasing
    value: Array  # [K, C]
    bend: Array  # [K, C], second derivative


def _solve(station: Array, value: Array, ends: Array | None) -> Array:
    """Second derivatives [K, C] at the knots: one tridiagonal system by the Thomas algorithm, as two scans.

    A knot is a row if the segment after it has a length, or if it is the last; other knots hand the neighbours on, so
    that repeated knots share the row of the last one of them.
    """
    step = jnp.pad(jnp.diff(station), (0, 1))
    slope = jnp.pad(safe.divide(jnp.diff(value, axis=0), step[:-1, None]), ((0, 1), (0, 0)))
    last = jnp.arange(station.shape[0]) == station.shape[0] - 1
    natural = ends is None
    start, end = (slope[0], slope[0]) if ends is None else (ends[0], ends[1])

    def forward(carry, knot):
        upper, right, step_before, slope_before = carry
        step_after, slope_after, is_last = knot
        row = (step_after > 0) | is_last
        first = step_before == 0
        slope_left = jnp.where(first, start, slope_before)
        slope_right = jnp.where(is_last, end, slope_after)
        diagonal = 2 * (step_before + step_after) - step_before * upper
        rest = 6 * (slope_right - slope_left) - step_before * right
        free = natural & (first | is_last)
        new_upper = jnp.where(free, 0, safe.divide(step_after, diagonal))
        new_right = jnp.where(free, 0, safe.divide(rest, diagonal))
        kept = (new_upper, new_right, step_after, slope_after)
        carry = jax.tree.map(lambda new, old: jnp.where(row, new, old), kept, carry)
        return carry, (new_upper, new_right, row)

    def backward(after, knot):
        upper, right, row = knot
        here = jnp.where(row, right - upper * after, after)
        return here, here

    zero, none = jnp.zeros_like(station[0]), jnp.zeros_like(value[0])
    _, rows = jax.lax.scan(forward, (zero, none, zero, none), (step, slope, last))
    _, bend = jax.lax.scan(backward, none, rows, reverse=True)
    return bend


def fit(
    station: Float[Array, "k"], value: Float[Array, "k c"], *, end_slopes: Float[Array, "2 c"] | None = None
) -> Spline:
    """The spline through the knots, clamped to the two end slopes, or natural (no bend at the ends) without them.

    Args: station [K, m], not decreasing, values equal where it repeats; value [K, C]; end_slopes, derivative at the
    first and last knot. Knots that are all one place give a constant.
    """
    return Spline(station, value, _solve(station, value, end_slopes))


def fit_path(
    points: Float[Array, "k 2"], end_headings: Float[Array, "2"] | None = None, *, natural: bool = False
) -> Spline:
    """The spline through a path's points over its chord length (Eq. 19-21), clamped to the end tangents.

    Args: points [m], may repeat; end_headings [rad] (default: those of the polyline); natural, no bend at the ends.
    """
    station = polyline.arc_length(points)
    if natural:
        return fit(station, points)
    if end_headings is None:
        vertex = polyline.headings(points)
        end_headings = jnp.stack([vertex[0], vertex[-1]])
    return fit(station, points, end_slopes=jnp.stack([jnp.cos(end_headings), jnp.sin(end_headings)], axis=-1))


def evaluate(spline: Spline, query: Float[Array, "*q"]) -> tuple[Array, Array, Array]:
    """Value, derivative and second derivative [*q, C] at the queries [m]; beyond an end the line goes straight on.

    Args: spline, of C channels; query [*q] m.
    """
    station, value, bend = spline.station, spline.value, spline.bend
    inside = jnp.clip(query, station[0], station[-1])
    beyond = (query - inside)[..., None]
    # The interval that ends at or after the query: of positive length, unless the query is the very start.
    at_start = jnp.sum(station <= station[0]) - 1
    index = jnp.searchsorted(station, inside, side="left", method="compare_all") - 1
    index = jnp.clip(jnp.maximum(index, at_start), 0, station.shape[0] - 2)
    step = (station[index + 1] - station[index])[..., None]
    b = safe.divide((inside - station[index])[..., None], step)
    a = 1 - b
    value_0, value_1, bend_0, bend_1 = value[index], value[index + 1], bend[index], bend[index + 1]
    on = a * value_0 + b * value_1 + ((a**3 - a) * bend_0 + (b**3 - b) * bend_1) * step * step / 6
    slope = safe.divide(value_1 - value_0, step) + ((3 * b * b - 1) * bend_1 - (3 * a * a - 1) * bend_0) * step / 6
    return on + beyond * slope, slope, jnp.where(beyond == 0, a * bend_0 + b * bend_1, 0)


def evaluate_path(spline: Spline, query: Float[Array, "*q"]) -> tuple[Array, Array, Array]:
    """Position [*q, 2] m, heading [*q] rad in [-pi, pi] and curvature [*q] 1/m of a planar spline at the queries.

    Args: spline, of x and y (m); query [*q] m.
    """
    position, slope, bend = evaluate(spline, query)
    (dx, dy), (ddx, ddy) = (slope[..., 0], slope[..., 1]), (bend[..., 0], bend[..., 1])
    speed = safe.norm(slope)
    return position, safe.arctan2(dy, dx), safe.divide(dx * ddy - dy * ddx, speed**3)
