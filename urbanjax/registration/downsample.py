"""Voxel down-sampling: one point for each occupied voxel, the mean of those in it."""

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.registration.cells import before, chosen, representatives
from urbanjax.registration.points import PointCloud, cloud
from urbanjax.types import POSITIVE, field, pytree, static


@pytree
class DownsampleParams:
    """How coarse, and how many points there may be."""

    resolution: float = field(default=0.25, metadata=POSITIVE)  # m, edge of a voxel
    # points of the result; None: as many as come in, so that none is lost
    capacity: int | None = static(default=None)


def voxels(points: np.ndarray, resolution: float) -> int:
    """How many points `downsample` makes of some, on the host: the capacity that they need.

    Args: points [N, 3] m, finite; resolution [m], edge of a voxel.
    """
    cell = np.floor(np.asarray(points, np.float32) / np.float32(resolution)).astype(np.int64)
    cell -= cell.min(0)
    _, y, z = (int(n) + 1 for n in cell.max(0))
    return len(np.unique((cell[:, 0] * y + cell[:, 1]) * z + cell[:, 2]))


def downsample(
    position: Float[Array, "n 3"], valid: Bool[Array, " n"], *, params: DownsampleParams
) -> tuple[PointCloud, Array]:
    """The means of the points [N, 3] (m) of each voxel, and how many voxels found no place in the capacity.

    Voxels begin at multiples of the resolution. Points that are not finite do not count. Args: position [N, 3] m; valid
    [N] bool, the points that count.
    """
    dtype, capacity = position.dtype, len(valid) if params.capacity is None else params.capacity
    valid = valid & jnp.all(jnp.isfinite(position), axis=1)
    position = jnp.where(valid[None], position.T, 0)
    cell = jnp.floor(position / params.resolution).astype(jnp.int32)
    first = representatives(cell, valid)
    leads = first == jnp.arange(len(valid), dtype=jnp.int32)
    number = jnp.where(valid, before(leads)[jnp.minimum(first, len(valid) - 1)], capacity)
    # Summed from the voxel's corner: sums of large coordinates would lose digits.
    beside = position - cell.astype(dtype) * params.resolution
    rows = jnp.concatenate([beside, jnp.ones((1, len(valid)), dtype)]).T
    sums = jnp.zeros((capacity, 4), dtype).at[number].add(rows, mode="drop")
    corner = cell.T[chosen(leads, capacity)].astype(dtype) * params.resolution
    total = jnp.sum(leads)
    there = jnp.arange(capacity) < total
    means = jnp.where(there[:, None], corner + sums[:, :3] / jnp.maximum(sums[:, 3:], 1), 0)
    return cloud(means, valid=there), jnp.maximum(total - capacity, 0)
