"""How long, and how far, a time to collision stays below a threshold (Minderhoud & Bovy 2001)."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.numerics import soft
from urbanjax.numerics.soft import Relaxation


def time_exposed(
    ttc: Float[Array, "*b t"],
    valid: Bool[Array, "*b t"],
    *,
    dt: float | Array,
    threshold: float | Array,
    relaxation: Relaxation,
) -> Float[Array, "*b"]:
    """TET [s], the time during which ttc <= threshold, each sample standing for dt.

    Piecewise constant, with a soft twin on the scale of the threshold.
    Args: ttc [..., T] s, inf for no collision; valid [..., T], samples that count; dt, threshold [s]; relaxation of the
    threshold.
    """
    # An infinite time is as good as one far beyond the threshold, and has finite derivatives.
    margin = threshold - jnp.minimum(ttc, 1e3 * threshold)
    if relaxation.mode == "hard":
        degree = (margin >= 0).astype(ttc.dtype)
    else:
        degree = soft.above(margin, 0.0, relaxation, scale=threshold)
    return dt * jnp.sum(jnp.where(valid, degree, 0), axis=-1)


def time_integrated(
    ttc: Float[Array, "*b t"], valid: Bool[Array, "*b t"], *, dt: float | Array, threshold: float | Array
) -> Float[Array, "*b"]:
    """TIT [s^2], the integral over time of threshold - ttc while that is positive, each sample standing for dt.

    Differentiable, but for a kink at the threshold.
    Args: ttc [..., T] s, inf for no collision; valid [..., T], samples that count; dt, threshold [s].
    """
    below = valid & (ttc < threshold)
    return dt * jnp.sum(jnp.where(below, threshold - ttc, 0), axis=-1)
