"""Maps of distributions: one mean and covariance per voxel of a dense window (Eq. 3-5)."""

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Bool, Float, Int

from urbanjax.numerics import symmetric
from urbanjax.registration.points import PointCloud
from urbanjax.types import POSITIVE, field, pytree, static

METHODS = ("vgicp", "ndt", "gicp")


@pytree
class MapParams:
    """How a map is made of points."""

    resolution: float = field(default=1.0, metadata=POSITIVE)  # m, edge of a voxel
    min_points: float = 6.0  # of a voxel, below which its scatter says nothing (ndt only)
    floor: float = 0.01  # share of the largest eigenvalue that the others have at least (ndt only)
    method: str = static(default="vgicp", metadata={"choices": METHODS})
    shape: tuple[int, int, int] = static(default=(256, 256, 32))  # voxels of the window along x, y and z
    per_voxel: int = static(default=16)  # points that a voxel holds (gicp only)


@pytree
class DistributionMap:
    """A dense window of X * Y * Z voxels; each holds the number of its distribution, one of V.

    With `gicp` each point is a distribution of its own, and the number is that of the voxel's list of points.
    """

    origin: Array  # [3] m, corner of the window in the map frame, a multiple of the resolution
    resolution: Array  # [] m
    table: Array  # [X * Y * Z] int32, number of the voxel's distribution; V where there is none
    rows: Array  # [V + 1, 10] mean (3) in m from the origin, covariance (6), number of points; the last is nothing
    lists: Array | None = None  # [V + 1, S] int32, rows of a voxel's points; V where there are no more (gicp only)
    left_out: Array | None = None  # [] points outside the window, or for which their voxel had no place
    shape: tuple[int, int, int] = static(default=(1, 1, 1))
    method: str = static(default="vgicp")


def build(points: PointCloud, params: MapParams, *, centre: Float[Array, "3"] | None = None) -> DistributionMap:
    """The map of a cloud in the map frame; points outside the window are left out, and counted.

    `vgicp`: mean of the points and mean of their covariances; `ndt`: mean and scatter of the points, with its small
    eigenvalues raised; `gicp`: each point with its own covariance. Args: points, the cloud in the map frame; centre [3]
    m, of the window (default: the mean of the points).
    """
    dtype = points.position.dtype
    if centre is None:
        total = jnp.sum(points.valid).astype(dtype)
        centre = jnp.sum(jnp.where(points.valid[None], points.position, 0), axis=1) / jnp.maximum(total, 1)
    size = jnp.asarray(params.resolution, dtype)
    half = jnp.array(params.shape, dtype) // 2
    origin = (jnp.floor(centre / size) - half) * size
    away = points.position - origin[:, None]
    cell = cell_of(away, size)
    kept = points.valid & within(cell, params.shape)
    n, outside = away.shape[1], jnp.sum(points.valid & ~kept, dtype=jnp.int32)
    place = jnp.where(kept, index_of(cell, params.shape), 0)
    # The first point of a voxel gives its distribution the number: no sorting.
    cells = params.shape[0] * params.shape[1] * params.shape[2]
    table = jnp.full(cells, n, jnp.int32).at[place].min(jnp.where(kept, jnp.arange(n, dtype=jnp.int32), n))
    slot = jnp.where(kept, table[place], n)
    if params.method == "gicp":
        rows = jnp.concatenate([away, points.covariance, jnp.ones((1, n), dtype)])
        rows = jnp.pad(jnp.where(kept[None], rows, 0).T, ((0, 1), (0, 0)))
        lists, waiting = _listed(slot, kept, params.per_voxel)
        return DistributionMap(
            origin, size, table, rows, lists, outside + waiting, shape=params.shape, method=params.method
        )
    rows = _gathered(points, away, cell, slot, params, size)
    return DistributionMap(origin, size, table, rows, left_out=outside, shape=params.shape, method=params.method)


def _listed(slot: Int[Array, " n"], kept: Bool[Array, " n"], places: int) -> tuple[Int[Array, "m s"], Int[Array, ""]]:
    """The points of each slot, and how many found no place: in each round the first one that is left gets the next."""
    n = slot.shape[0]
    index = jnp.arange(n, dtype=jnp.int32)

    def step(waits: Array, _: None) -> tuple[Array, Array]:
        first = jnp.full(n + 1, n, jnp.int32).at[slot].min(jnp.where(waits, index, n))
        return waits & (first[slot] != index), first

    waits, lists = lax.scan(step, kept, None, length=places)
    return lists.T, jnp.sum(waits, dtype=jnp.int32)


def _gathered(
    points: PointCloud,
    away: Float[Array, "3 n"],
    cell: Int[Array, "3 n"],
    slot: Int[Array, " n"],
    params: MapParams,
    size: Float[Array, ""],
) -> Float[Array, "m 10"]:
    """The distributions of the voxels, by slot; `n` is the slot of the points that are left out."""
    n, dtype = away.shape[1], away.dtype
    kept = slot < n
    middle = (cell.astype(dtype) + 0.5) * size
    beside = away - middle
    spread = points.covariance if params.method == "vgicp" else symmetric.outer(beside)
    rows = jnp.concatenate([beside, spread, jnp.ones((1, n), dtype)]).T
    sums = jnp.zeros((n + 1, 10), dtype).at[slot].add(jnp.where(kept[:, None], rows, 0))
    count = sums[:, 9]
    means = sums / jnp.maximum(count, 1)[:, None]
    covariance = means[:, 3:9]
    if params.method == "ndt":
        scatter = covariance.T - symmetric.outer(means[:, :3].T)
        unbiased = scatter * (count / jnp.maximum(count - 1, 1))[None]
        covariance = _raised(unbiased, params.floor).T
        count = jnp.where(count >= params.min_points, count, 0)
    # All points of a voxel share its middle; scattering any of them gives it to the distribution.
    middles = jnp.zeros((n + 1, 3), dtype).at[slot].set(jnp.where(kept[:, None], middle.T, 0))
    mean = jnp.where(count[:, None] > 0, means[:, :3] + middles, 0)
    return jnp.concatenate([mean, covariance, count[:, None]], 1)


def cell_of(away: Float[Array, "3 *n"], resolution: Float[Array, ""]) -> Int[Array, "3 *n"]:
    """The voxel of points given from the window's corner.

    Args: away [3, N] m, from the window's corner; resolution [m], edge of a voxel.
    """
    return jnp.floor(away / resolution).astype(jnp.int32)


def within(cell: Int[Array, "3 *n"], shape: tuple[int, int, int]) -> Bool[Array, "*n"]:
    """Whether a voxel lies in the window.

    Args: cell [3, N], voxels counted from the window's corner; shape, voxels of the window along x, y and z.
    """
    inside = [(cell[i] >= 0) & (cell[i] < shape[i]) for i in range(3)]
    return inside[0] & inside[1] & inside[2]


def index_of(cell: Int[Array, "3 *n"], shape: tuple[int, int, int]) -> Int[Array, "*n"]:
    """The place of a voxel in the table.

    Args: cell [3, N], voxels counted from the window's corner; shape, voxels of the window along x, y and z.
    """
    return (cell[0] * shape[1] + cell[1]) * shape[2] + cell[2]


def _raised(s: Float[Array, "6 n"], floor: float | Array) -> Float[Array, "6 n"]:
    """Covariances whose eigenvalues are at least `floor` times the largest one."""
    low, middle, high = symmetric.eigenvalues(s)
    least = floor * high
    first, last = symmetric.smallest_eigenvector(s), symmetric.smallest_eigenvector(-s)
    second = jnp.stack(
        [
            last[1] * first[2] - last[2] * first[1],
            last[2] * first[0] - last[0] * first[2],
            last[0] * first[1] - last[1] * first[0],
        ]
    )
    lift = jnp.maximum(least - low, 0)[None] * symmetric.outer(first)
    return s + lift + jnp.maximum(least - middle, 0)[None] * symmetric.outer(second)
