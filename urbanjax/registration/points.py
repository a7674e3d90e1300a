"""Point clouds of static capacity: structures of arrays, points last, so that arithmetic on them vectorises."""

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.numerics import symmetric
from urbanjax.types import CloudError, pytree


@pytree
class PointCloud:
    """N points, of which the valid ones count, with the shape of the surface around each."""

    position: Array  # [3, N] m
    covariance: Array  # [6, N] entries xx, xy, xz, yy, yz, zz; no unit where it is regularised to a plane
    normal: Array  # [3, N] unit vectors
    valid: Array  # [N] bool


def padded(
    points: np.ndarray, capacity: int, *, origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> tuple[np.ndarray, np.ndarray]:
    """Points [N, 3] (m) of any number as float32 [capacity, 3] and a mask, on the host: one shape, one compilation.

    Raises CloudError if there are none, more than `capacity`, or some that are not finite. Args: points [N, 3] m, on
    the host; capacity, points of the result; origin [m], taken off in double precision: map coordinates of many
    kilometres have no millimetres in float32.
    """
    points = np.asarray(points, np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        raise CloudError(f"a cloud of shape {points.shape} was given: points [N, 3] with N > 0 are needed")
    if len(points) > capacity:
        raise CloudError(f"{len(points)} points do not fit the capacity {capacity}: raise it, or thin them out first")
    if not np.isfinite(points).all():
        raise CloudError(f"{int((~np.isfinite(points)).any(1).sum())} points are not finite: remove them")
    out = np.zeros((capacity, 3), np.float32)
    out[: len(points)] = points - np.asarray(origin)
    return out, np.arange(capacity) < len(points)


def cloud(
    position: Float[Array, "n 3"],
    covariance: Float[Array, "n 3 3"] | None = None,
    *,
    valid: Bool[Array, " n"] | None = None,
) -> PointCloud:
    """A cloud of points with their covariances.

    Args: position [N, 3] m; covariance [N, 3, 3] m^2 (no unit where it is regularised), by default the identity; valid
    [N] bool, by default all.
    """
    n = position.shape[0]
    eye = jnp.broadcast_to(jnp.eye(3, dtype=position.dtype), (n, 3, 3))
    shape = eye if covariance is None else covariance
    there = jnp.ones(n, bool) if valid is None else valid
    return PointCloud(
        position=position.T,
        covariance=symmetric.pack(shape),
        normal=jnp.zeros((3, n), position.dtype),
        valid=there,
    )
