"""The point-cloud map of a whole district as distributions, and the window of it that a scan is registered on."""

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from urbanjax.registration.distributions import DistributionMap, MapParams, index_of, within
from urbanjax.types import CloudError, pytree, static

CAPACITY = 32768  # voxels of a window, where none is set
ASIDE = 150.0  # m, to which something is taken out of a map


@pytree
class VoxelMap:
    """V distributions, one per occupied voxel, sorted by rows of square tiles: a stretch of a row is one block.

    A position is kept as its voxel and what is left within it, so that float32 is exact to a micrometre at any
    distance from the map's origin.
    """

    cell: Array  # [V, 3] int32, voxel, counted from the map's first one
    rows: Array  # [V, 10] mean (3) in m from the voxel's corner, covariance (6), number of points
    start: Array  # [TY, TX + 1] int32, where each tile of a row of tiles begins
    first: Array  # [3] int32, the map's first voxel, in multiples of the resolution
    resolution: Array  # [] m, edge of a voxel
    tile: int = static(default=16)  # voxels along the edge of a tile
    method: str = static(default="vgicp")


@pytree
class CutParams:
    """Sizes of a window: they cost memory and time whatever the map holds."""

    # voxels that hold something; None: enough for most (localization.capacity chooses by the map)
    capacity: int | None = static(default=None)
    shape: tuple[int, int, int] = static(default=(208, 208, 32))  # voxels along x, y and z

    @property
    def size(self) -> int:
        """The capacity, whether it was set or not."""
        return CAPACITY if self.capacity is None else self.capacity


def voxelise(
    position: np.ndarray, covariance: np.ndarray, *, count: np.ndarray, params: MapParams, tile: int = 16
) -> VoxelMap:
    """The map of points with covariances; on the host.

    `vgicp`: mean of the points and of their covariances. `ndt`: mean and scatter of the points, its small eigenvalues
    raised. Raises CloudError if there are no points, some that are not finite, or for `gicp`, which has no voxels.
    Args: position [N, 3] m; covariance [N, 6] (xx, xy, xz, yy, yz, zz); count [N], the points that each stands for;
    tile, voxels along the edge of a tile.
    """
    if params.method == "gicp":
        raise CloudError("a district is mapped by voxels: choose the method vgicp or ndt, not gicp")
    if not len(position) or not np.isfinite(position).all() or not np.isfinite(covariance).all():
        raise CloudError("a map needs points, and finite ones: check the scans that it is made of")
    size = float(params.resolution)
    voxel = np.floor(position / size).astype(np.int64)
    first = voxel.min(0)
    cell = voxel - first
    extent = cell.max(0) + 1
    tiles = -(-extent // tile)
    key = (cell[:, 1] // tile) * tiles[0] + cell[:, 0] // tile
    order = np.lexsort((cell[:, 2], cell[:, 0], cell[:, 1], key))
    cell, key = cell[order], key[order]
    new = np.flatnonzero(np.any(np.diff(cell, axis=0, prepend=-1), axis=1))
    within_voxel = position[order] - (cell + first) * size
    share = count[order][:, None].astype(float)
    number = np.add.reduceat(share, new)
    mean = np.add.reduceat(share * within_voxel, new) / number
    if params.method == "vgicp":
        spread = np.add.reduceat(share * covariance[order], new) / number
    else:
        spread, number = _scatter(within_voxel, share, new, mean, number, params)
    begin = np.searchsorted(key[new], np.arange(tiles[0] * tiles[1] + 1))
    start = np.stack([begin[y * tiles[0] : (y + 1) * tiles[0] + 1] for y in range(tiles[1])])
    return VoxelMap(
        cell=jnp.asarray(cell[new], jnp.int32),
        rows=jnp.asarray(np.concatenate([mean, spread, number], 1), jnp.zeros(()).dtype),
        start=jnp.asarray(start, jnp.int32),
        first=jnp.asarray(first, jnp.int32),
        resolution=jnp.asarray(size),
        tile=tile,
        method=params.method,
    )


def _scatter(
    beside: np.ndarray, share: np.ndarray, new: np.ndarray, mean: np.ndarray, number: np.ndarray, params: MapParams
) -> tuple[np.ndarray, np.ndarray]:
    """Unbiased scatter [V, 6] with raised eigenvalues, and counts, 0 where there are too few points."""
    outer = beside[:, :, None] * beside[:, None, :]
    scatter = np.add.reduceat(share[:, :, None] * outer, new) / number[:, :, None] - mean[:, :, None] * mean[:, None, :]
    scatter *= (number / np.maximum(number - 1, 1))[:, :, None]
    values, vectors = np.linalg.eigh(scatter)
    values = np.maximum(values, float(params.floor) * values[:, -1:])
    raised = np.einsum("vik,vk,vjk->vij", vectors, values, vectors)
    i, j = np.triu_indices(3)
    return raised[:, i, j], np.where(number >= float(params.min_points), number, 0)


def cut(
    world: VoxelMap, centre: Float[Array, "3"], *, radius: Float[Array, ""], params: CutParams
) -> tuple[DistributionMap, Array]:
    """The distributions whose means are within `radius` m of `centre` in the plane (Eq. 6-7), as a dense window.

    Shapes do not depend on the map, the place or the radius, so nothing compiles anew. Returns also how many voxels
    found no place in the capacity. Args: world, the map of the district; centre [3] m in the map frame; radius [m].
    """
    dtype, size, shape = world.rows.dtype, world.resolution, params.shape
    middle = jnp.floor(centre / size).astype(jnp.int32)
    corner = middle - world.first - jnp.array([n // 2 for n in shape], jnp.int32)
    index, there, total = _stretches(world, corner, params)
    cell = world.cell[index].T - corner[:, None]
    held = world.rows[index]
    origin = (corner + world.first).astype(dtype) * size
    mean = cell.astype(dtype) * size + held[:, :3].T
    away = mean - (centre - origin)[:, None]
    kept = there & within(cell, shape) & (away[0] ** 2 + away[1] ** 2 < radius**2)
    cells = shape[0] * shape[1] * shape[2]
    place = jnp.where(kept, index_of(cell, shape), cells)
    numbers = jnp.arange(params.size, dtype=jnp.int32)
    table = jnp.full(cells, params.size, jnp.int32).at[place].set(numbers, mode="drop")
    count = jnp.where(kept, held[:, 9], 0)
    rows = jnp.concatenate([mean.T, held[:, 3:9], count[:, None]], axis=1)
    rows = jnp.concatenate([rows, jnp.zeros((1, 10), dtype)])
    window = DistributionMap(origin, size, table, rows, shape=shape, method=world.method)
    return window, jnp.maximum(total - params.size, 0)


def _stretches(world: VoxelMap, corner: Array, params: CutParams) -> tuple[Array, Array, Array]:
    """The map's rows in the tiles that the window touches [C], which of them there are, and how many there would be."""
    tile, (rows, columns) = world.tile, world.start.shape
    row = corner[1] // tile + jnp.arange(-(-params.shape[1] // tile) + 1, dtype=jnp.int32)
    left = jnp.clip(corner[0] // tile, 0, columns - 1)
    right = jnp.clip((corner[0] + params.shape[0] - 1) // tile + 1, 0, columns - 1)
    known = jnp.clip(row, 0, rows - 1)
    begin, end = world.start[known, left], world.start[known, right]
    count = jnp.where((row >= 0) & (row < rows), end - begin, 0)
    ends = jnp.cumsum(count)
    slot = jnp.arange(params.size, dtype=jnp.int32)
    which = jnp.minimum(jnp.sum(slot[:, None] >= ends[None, :], axis=1), len(row) - 1)
    there = slot < ends[-1]
    return jnp.where(there, (begin - ends + count)[which] + slot, 0), there, ends[-1]


def without(
    world: VoxelMap, centre: Float[Array, "2"], *, heading: Float[Array, ""], length: float | Array
) -> VoxelMap:
    """The map without what lies in a slab across a road: its voxels hold no points any more. Shapes stay.

    Args: world, the map; centre [2] m, of the slab; heading [] rad, of the road; length [m] of the slab along it; it
    reaches `ASIDE` to both sides.
    """
    place = (world.cell + world.first[None])[:, :2].astype(world.rows.dtype) * world.resolution + world.rows[:, :2]
    away = place - centre[None]
    along = away[:, 0] * jnp.cos(heading) + away[:, 1] * jnp.sin(heading)
    gone = (jnp.abs(along) < length / 2) & (jnp.sum(away**2, axis=1) < ASIDE**2)
    return world.replace(rows=world.rows.at[:, 9].multiply(jnp.where(gone, 0.0, 1.0)))


def padded(world: VoxelMap, voxels: int, *, tiles: int) -> VoxelMap:
    """The same map in arrays that maps of other places share, so that one program serves all (host side).

    Raises CloudError where it does not fit. Args: world, the map; voxels, V of the result; tiles, along x and along y.
    """
    held, (rows, columns) = len(world.cell), world.start.shape
    if held > voxels or rows > tiles or columns > tiles + 1:
        raise CloudError(
            f"a map of {held} voxels, {rows} x {columns - 1} tiles, does not fit into {voxels}, {tiles} x {tiles}: "
            "map less, or raise the voxel size"
        )
    start = np.pad(np.asarray(world.start), ((0, 0), (0, tiles + 1 - columns)), mode="edge")
    start = np.pad(start, ((0, tiles - rows), (0, 0)), constant_values=held)
    return world.replace(
        cell=np.pad(np.asarray(world.cell), ((0, voxels - held), (0, 0))),
        rows=np.pad(np.asarray(world.rows), ((0, voxels - held), (0, 0))),
        start=start.astype(np.int32),
    )
