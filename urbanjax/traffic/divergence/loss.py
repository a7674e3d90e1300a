"""A smooth relative of the divergence, for use as a loss: no neighbours, so no choice that gradients cannot see."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Bool, Float

from urbanjax.numerics import safe

BLOCK = 256  # rows of the kernel matrix that are held at once


def squared_mmd(
    x: Float[Array, "n d"],
    y: Float[Array, "m d"],
    *,
    valid_x: Bool[Array, " n"],
    valid_y: Bool[Array, " m"],
    scales: Sequence[float] = (0.5, 2.0, 8.0),
) -> Float[Array, ""]:
    """Squared maximum mean discrepancy of two sample sets (Gretton et al. 2012, unbiased), mean over Gaussian kernels.

    0 on average where both come from one distribution, and then also negative; smooth in all points. Time n * m, memory
    linear.
    Args: x [N, D], y [M, D] m; valid_x [N], valid_y [M], samples that count; scales, standard deviations of the kernels
    [m].
    """
    within = _total(x, x, valid_x, valid_x, scales), _total(y, y, valid_y, valid_y, scales)
    n, m = (jnp.sum(valid, dtype=x.dtype) for valid in (valid_x, valid_y))
    # A sample's kernel with itself is 1.
    own = [safe.divide(total - count, count * (count - 1)) for total, count in zip(within, (n, m), strict=True)]
    return own[0] + own[1] - 2 * safe.divide(_total(x, y, valid_x, valid_y, scales), n * m)


def _total(x: Array, y: Array, valid_x: Array, valid_y: Array, scales: Sequence[float]) -> Array:
    """Sum of the kernel over all pairs."""

    @jax.checkpoint
    def row(point: tuple[Array, Array]) -> Array:
        squared = jnp.sum((y - point[0][None]) ** 2, axis=-1)
        kernel = sum((jnp.exp(-squared / (2 * scale**2)) for scale in scales), jnp.zeros_like(squared)) / len(scales)
        return jnp.where(point[1], jnp.sum(jnp.where(valid_y, kernel, 0)), 0)

    return jnp.sum(lax.map(row, (jnp.where(valid_x[:, None], x, 0), valid_x), batch_size=BLOCK))
