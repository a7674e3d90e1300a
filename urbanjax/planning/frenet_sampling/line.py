"""A reference line at uniform stations, and what one look-up in its table gives."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.geometry.frenet import cell
from urbanjax.numerics.once import once
from urbanjax.roadmap.corridor import Corridor
from urbanjax.types import pytree


@pytree
class ReferenceLine:
    """A reference line at uniform stations, with the differences to the next row, so that one look-up does."""

    rows: Array  # [G, 10] x, y (m), heading (rad), curvature (1/m), its derivative (1/m^2); and their differences
    start: Array  # [] m
    spacing: Array  # [] m


@pytree
class LineFoot:
    """The reference line at some stations [*q]."""

    x: Array  # m
    y: Array  # m
    heading: Array  # rad
    cos: Array
    sin: Array
    curvature: Array  # 1/m
    curvature_slope: Array  # 1/m^2
    outside: Array  # bool, before the line's start or past its end


def reference_line(
    position: Float[Array, "g 2"],
    heading: Float[Array, "g"],
    *,
    curvature: Float[Array, "g"],
    start: float | Float[Array, ""],
    spacing: float | Float[Array, ""],
) -> ReferenceLine:
    """The table of a line given at uniform stations.

    Args: position [G, 2] m; heading [G] rad, unwrapped; curvature [G] 1/m; start [] m, the station of the first row;
    spacing [] m, between rows.
    """
    slope = jnp.asarray(jnp.gradient(curvature)) / spacing
    rows = jnp.stack([position[:, 0], position[:, 1], heading, curvature, slope], axis=1)
    rows = jnp.concatenate([rows, jnp.diff(rows, axis=0, append=rows[-1:])], axis=1)
    return ReferenceLine(rows, jnp.asarray(start, rows.dtype), jnp.asarray(spacing, rows.dtype))


def along_route(window: Corridor) -> ReferenceLine:
    """The reference line of a route. Args: window, of the route's corridor."""
    return reference_line(
        window.position, window.heading, curvature=window.curvature, start=window.station[0], spacing=window.spacing
    )


def look_up(line: ReferenceLine, station: Float[Array, "*q"]) -> LineFoot:
    """The line at some stations: an arc between two rows, and straight on beyond an end (its curvature is kept).

    Args: line; station [*q] m.
    """
    index, share, beyond = cell(line.start, line.spacing, n=line.rows.shape[0], station=station)
    row = line.rows.at[index].get(mode="promise_in_bounds")
    x, y, heading, curvature, slope = (row[..., i] + share * row[..., 5 + i] for i in range(5))
    cos, sin = once(jnp.cos(heading), jnp.sin(heading))
    sag = curvature * share * (1 - share) * line.spacing**2 / 2  # of the arc beside its chord
    x, y = x + sin * sag + beyond * cos, y - cos * sag + beyond * sin
    return LineFoot(x, y, heading, cos, sin, curvature, slope, outside=beyond != 0)
