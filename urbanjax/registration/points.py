"""Point clouds of static capacity: structures of arrays, points last, so that arithmetic on them vectorises."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.types import pytree


@pytree
class PointCloud:
    """N points, of which the valid ones count, with the shape of the surface around each."""

    position: Array  # [3, N] m
    covariance: Array  # [6, N] entries xx, xy, xz, yy, yz, zz; no unit where it is regularised to a plane
    normal: Array  # [3, N] unit vectors
    valid: Array  # [N] bool


def cloud(
    position: Float[Array, "n 3"],
    covariance: Float[Array, "n 3 3"] | None = None,
    valid: Bool[Array, " n"] | None = None,
    capacity: int | None = None,
) -> PointCloud:
    """A cloud from points [N, 3] (m), padded to `capacity` invalid ones. Without covariances they are the identity."""
    n = position.shape[0]
    more = 0 if capacity is None else capacity - n
    eye = jnp.broadcast_to(jnp.eye(3, dtype=position.dtype), (n, 3, 3))
    shape = eye if covariance is None else covariance
    there = jnp.ones(n, bool) if valid is None else valid
    entries = jnp.stack([shape[:, i, j] for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))])
    return PointCloud(
        position=jnp.pad(position.T, ((0, 0), (0, more))),
        covariance=jnp.pad(entries, ((0, 0), (0, more))),
        normal=jnp.zeros((3, n + more), position.dtype),
        valid=jnp.pad(there, (0, more)),
    )
