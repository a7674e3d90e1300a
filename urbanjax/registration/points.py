"""Point clouds of static capacity: structures of arrays, points last, so that arithmetic on them vectorises."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.numerics import symmetric
from urbanjax.types import CloudError, pytree
from urbanjax.types.arguments import array, traced

GOLDEN = (np.sqrt(5) - 1) / 2


@pytree
class PointCloud:
    """N points, of which the valid ones count, with the shape of the surface around each."""

    position: Array  # [3, N] m
    covariance: Array  # [6, N] entries xx, xy, xz, yy, yz, zz; no unit where it is regularised to a plane
    normal: Array  # [3, N] unit vectors
    valid: Array  # [N] bool


def checked(points: Any, name: str = "cloud") -> np.ndarray:
    """The points as float64 [N, 3] (m), on the host.

    Raises CloudError, with the name, for anything but finite points. Args: points [N, 3] m; name, for the message.
    """
    points = array(points, name, error=CloudError)
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        remedy = "transpose it" if points.ndim == 2 and points.shape[0] == 3 else "take x, y and z"
        raise CloudError(f"{name} has the shape {points.shape}: points [N, 3] with N > 0 are needed; {remedy}")
    if not np.isfinite(points).all():
        raise CloudError(f"{name}: {int((~np.isfinite(points)).any(1).sum())} points are not finite: remove them")
    return points


def padded(
    points: np.ndarray, capacity: int, *, origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> tuple[np.ndarray, np.ndarray]:
    """Points [N, 3] (m) of any number as float32 [capacity, 3] and a mask, on the host: one shape, one compilation.

    Raises CloudError if there are none, more than `capacity`, or some that are not finite. Args: points [N, 3] m, on
    the host; capacity, points of the result; origin [m], taken off in double precision: map coordinates of many
    kilometres have no millimetres in float32.
    """
    points = checked(points)
    if len(points) > capacity:
        raise CloudError(f"{len(points)} points do not fit the capacity {capacity}: raise it, or thin them out first")
    out = np.zeros((capacity, 3), np.float32)
    out[: len(points)] = points - np.asarray(origin)
    return out, np.arange(capacity) < len(points)


def cloud(
    position: Float[Array, "n 3"],
    covariance: Float[Array, "n 3 3"] | None = None,
    *,
    valid: Bool[Array, " n"] | None = None,
) -> PointCloud:
    """A cloud of points with their covariances. Raises CloudError for shapes that are not those below.

    Outside jit also for points that count and are not finite.

    Args: position [N, 3] m; covariance [N, 3, 3] m^2 (no unit where it is regularised), by default the identity; valid
    [N] bool, by default all.
    """
    if jnp.ndim(position) != 2 or position.shape[1] != 3:
        raise CloudError(f"position has the shape {jnp.shape(position)}: points [N, 3] are needed")
    n = position.shape[0]
    for name, values, shape in (("covariance", covariance, (n, 3, 3)), ("valid", valid, (n,))):
        if values is not None and jnp.shape(values) != shape:
            raise CloudError(f"{name} has the shape {jnp.shape(values)}, and position {position.shape}: not {shape}")
    counted = position if valid is None else jnp.where(valid[:, None], position, 0)
    if not traced(counted) and not np.isfinite(counted).all():
        raise CloudError("points that count are not finite: remove them, or set valid to False there")
    eye = jnp.broadcast_to(jnp.eye(3, dtype=position.dtype), (n, 3, 3))
    shape = eye if covariance is None else covariance
    there = jnp.ones(n, bool) if valid is None else valid
    return PointCloud(
        position=position.T,
        covariance=symmetric.pack(shape),
        normal=jnp.zeros((3, n), position.dtype),
        valid=there,
    )


def thinned(points: PointCloud, every: int) -> PointCloud:
    """One of `every` points, not always the same one of them: what repeats itself in their order does not matter.

    Args: points, the cloud; every, at least 1.
    """
    n = -(-points.valid.shape[0] // every)
    group = np.arange(n)
    index = np.minimum(group * every + np.floor(every * (group * GOLDEN % 1)).astype(int), points.valid.shape[0] - 1)
    return PointCloud(*(x[..., index] for x in (points.position, points.covariance, points.normal, points.valid)))
