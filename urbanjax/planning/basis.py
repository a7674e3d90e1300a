"""Functions on uniform grids as products with small weight matrices: no gathers, smooth where it matters."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import lean


def hat(
    query: Float[Array, "n"], start: float | Array, spacing: float | Array, count: int, *, extrapolate: bool = False
) -> Float[Array, "n g"]:
    """Weights [n, G] of linear interpolation at each query on the grid start + spacing * [0 .. count).

    Args: query [n]; start and spacing, of the grid, in the unit of the query; count G, of its points; extrapolate: past
    the end the last slope holds, elsewhere outside the grid the end value.
    """
    u = (query - start) / spacing
    inside = lean.clip(u, 0.0, count - 1.0)
    cell = lean.minimum(jnp.floor(inside), count - 2)[:, None]
    index = np.arange(count, dtype=query.dtype)[None, :]
    # Told by the cell and not as max(0, 1 - |u - index|): there on a grid point the derivatives would not add up to 0.
    fraction = inside[:, None] - cell
    weights = jnp.where(index == cell, 1 - fraction, 0) + jnp.where(index == cell + 1, fraction, 0)
    if not extrapolate:
        return weights
    last = np.zeros(count, query.dtype)
    last[-2:] = -1, 1
    return weights + lean.maximum(u - (count - 1), 0)[:, None] * last[None, :]


def interpolate(
    query: Float[Array, "n"], start: float | Array, spacing: float | Array, values: Float[Array, "g *c"]
) -> Float[Array, "n *c"]:
    """Values [n, ..] interpolated linearly from a uniform grid, the end values holding outside.

    Args: query [n]; start and spacing, of the grid, in the unit of the query; values [G, ..], at its points.
    """
    return product(hat(query, start, spacing, values.shape[0]), values)


def product(weights: Float[Array, "n g"], values: Float[Array, "g *c"]) -> Float[Array, "n *c"]:
    """Weighted sums [n, ..] over the grid, in full precision on every device: positions lose centimetres otherwise.

    Args: weights [n, G]; values [G, ..], at the points of the grid.
    """
    return jnp.tensordot(weights, values, axes=1, precision=jax.lax.Precision.HIGHEST)


def smooth(
    query: Float[Array, "n"], start: float | Array, spacing: float | Array, values: Float[Array, "g"]
) -> tuple[Float[Array, "n"], Float[Array, "n"], Float[Array, "n"]]:
    """The uniform cubic B-spline with control points `values`: value, first and second derivative at each query.

    C2; it passes through the first control point and holds the last one from one spacing past the grid on. A step of
    one control point is spread over about three spacings, without overshoot. Args: query [n]; start and spacing, of the
    grid, in the unit of the query; values [G].
    """
    count = values.shape[0]
    control = jnp.concatenate([2 * values[:1] - values[1:2], values, values[-1:], values[-1:]])
    u = lean.clip((query - start) / spacing, 0.0, float(count))
    x = u[:, None] + 1 - np.arange(count + 3, dtype=query.dtype)[None, :]
    r = jnp.abs(x)
    outer = lean.maximum(2 - r, 0)
    near = r < 1
    value = jnp.where(near, 2 / 3 - x * x + x * x * r / 2, outer**3 / 6)
    first = jnp.where(near, -2 * x + 1.5 * x * r, -(outer**2) / 2 * jnp.sign(x))
    second = jnp.where(near, -2 + 3 * r, outer)
    stacked = product(jnp.concatenate([value, first, second]), control).reshape(3, -1)
    return stacked[0], stacked[1] / spacing, stacked[2] / spacing**2
