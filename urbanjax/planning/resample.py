"""Candidates as C2 cubic splines over their arc length (Eq. 19-21)."""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.geometry import spline
from urbanjax.numerics import safe
from urbanjax.planning.costs import segments


def arc_length_splines(
    position: Float[Array, "j k 2"], heading: Float[Array, "j k"]
) -> tuple[Float[Array, "j k"], Float[Array, "j k"]]:
    """Heading [J, K] (rad) and curvature [J, K] (1/m) at the points of J paths, of the splines through them.

    Knots are the points themselves, over cumulative chord length, clamped to the tangents at both ends. Eq. 20-21 as
    printed have no argument local to a knot. Args: position (m); heading (rad), of which the ends are used, and the
    whole turns.
    """
    step = segments(position)
    station = jnp.pad(jnp.cumsum(step, axis=1), ((0, 0), (1, 0)))
    ends = jnp.stack([jnp.cos(heading[:, :: heading.shape[1] - 1]), jnp.sin(heading[:, :: heading.shape[1] - 1])], -1)
    local = position - position[:, :1]
    bend = jax.vmap(spline.fit)(station, local, end_slopes=ends).bend
    step = step[..., None]
    rise = safe.divide(local[:, 1:] - local[:, :-1], step)
    ahead = rise - step * (2 * bend[:, :-1] + bend[:, 1:]) / 6
    last = rise[:, -1:] + step[:, -1:] * (bend[:, -2:-1] + 2 * bend[:, -1:]) / 6
    slope = jnp.concatenate([ahead, last], axis=1)
    turned = safe.arctan2(
        slope[..., 1] * jnp.cos(heading) - slope[..., 0] * jnp.sin(heading),
        slope[..., 0] * jnp.cos(heading) + slope[..., 1] * jnp.sin(heading),
    )
    size = safe.norm(slope)
    return heading + turned, safe.divide(slope[..., 0] * bend[..., 1] - slope[..., 1] * bend[..., 0], size**3)
