"""Weights of correspondences by their squared Mahalanobis distance: robust kernels and the likelihood of NDT."""

import math

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import safe

KERNELS = ("none", "huber", "cauchy")


def weight(squared: Float[Array, " n"], kernel: str, *, scale: float | Array) -> Float[Array, " n"]:
    """Weight of iteratively reweighted least squares [N].

    Args: squared [N], Mahalanobis distances; kernel, one of `KERNELS`; scale [-], the distance at which the kernel sets
    in.
    """
    if kernel == "none":
        return jnp.ones_like(squared)
    if kernel == "cauchy":
        return 1 / (1 + squared / scale**2)
    return jnp.minimum(1.0, safe.divide(jnp.ones_like(squared) * scale, safe.sqrt(squared), otherwise=1.0))


def likelihood(
    squared: Float[Array, " n"], outlier_share: float | Array, *, resolution: Float[Array, ""]
) -> Float[Array, " n"]:
    """Weight -d1 d2 exp(-d2 q / 2) [N] of the NDT score (Magnusson 2009).

    Args: squared [N], Mahalanobis distances; outlier_share, of points that the map does not explain; resolution [m] of
    the map's voxels.
    """
    o = jnp.asarray(outlier_share, squared.dtype)
    # 10 and exp(-1/2) are those of the NDT in PCL.
    c1, c2 = 10 * (1 - o), o / resolution**3
    d3 = -jnp.log(c2)
    d1 = -jnp.log(c1 + c2) - d3
    d2 = -2 * jnp.log((-jnp.log(c1 * math.exp(-0.5) + c2) - d3) / d1)
    return -d1 * d2 * jnp.exp(-d2 * squared / 2)
