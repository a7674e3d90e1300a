"""Voxel down-sampling: one point for each occupied voxel, the mean of those in it."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.registration.cells import number_cells, slots_for
from urbanjax.registration.points import PointCloud, cloud
from urbanjax.types import pytree, static


@pytree
class DownsampleParams:
    """How coarse, and how many points there may be."""

    resolution: float = 0.25  # m, edge of a voxel
    capacity: int = static(default=8192)  # points of the result


def downsample(
    position: Float[Array, "n 3"], valid: Bool[Array, " n"], params: DownsampleParams
) -> tuple[PointCloud, Array]:
    """The means of the points [N, 3] (m) of each voxel, and how many voxels found no place in the capacity.

    Voxels begin at multiples of the resolution. Points that are not finite do not count.
    """
    dtype = position.dtype
    valid = valid & jnp.all(jnp.isfinite(position), axis=1)
    position = jnp.where(valid[:, None], position, 0)
    cell = jnp.floor(position / params.resolution)
    slots = slots_for(position.shape[0])
    slot = number_cells(cell.astype(jnp.int32).T, valid, slots)
    # Summed from the voxel's corner: sums of large coordinates would lose digits.
    corner = cell * params.resolution
    rows = jnp.concatenate([position - corner, jnp.ones((len(slot), 1), dtype)], axis=1)
    sums = jnp.zeros((slots + 1, 4), dtype).at[slot].add(rows)[:-1]
    corners = jnp.zeros((slots + 1, 3), dtype).at[slot].set(corner)[:-1]
    occupied = sums[:, 3] > 0
    place = jnp.cumsum(occupied) - 1
    place = jnp.where(occupied & (place < params.capacity), place, params.capacity)
    means = corners + sums[:, :3] / jnp.maximum(sums[:, 3:], 1)
    kept = jnp.zeros((params.capacity + 1, 3), dtype).at[place].set(means)[:-1]
    total = jnp.sum(occupied)
    return cloud(kept, valid=jnp.arange(params.capacity) < total), jnp.maximum(total - params.capacity, 0)
