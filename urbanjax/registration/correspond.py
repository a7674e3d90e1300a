"""Which distribution of the map each point belongs to."""

import itertools

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int

from urbanjax.numerics.once import once
from urbanjax.registration.distributions import DistributionMap, cell_of, index_of, within

_AXES = ((0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
OFFSETS = {1: _AXES[:1], 7: _AXES, 27: tuple(itertools.product((-1, 0, 1), repeat=3))}


def correspond(
    target: DistributionMap, away: Float[Array, "3 n"], *, valid: Bool[Array, " n"], neighbours: int
) -> Int[Array, " n"]:
    """The row of the map's distribution nearest to each point, among the voxels around it; the last row if none.

    With `gicp` that is the nearest point exactly, up to a distance of the map's resolution, if 27 voxels are looked at
    and none of them has more points than it has places. Args: target, the map; away [3, N] m, points from the map's
    origin; valid [N] bool; neighbours, voxels to look at: 1 (the point's own), 7 or 27.
    """
    nothing = target.rows.shape[0] - 1
    cell = cell_of(away, target.resolution)

    def numbered(offset: tuple[int, int, int]) -> Array:
        near = cell + jnp.array(offset, jnp.int32)[:, None]
        inside = valid & within(near, target.shape)
        # Apart from the look-up, which is no vector operation on a CPU, and would make none of what it takes in.
        place, inside = once(jnp.where(inside, index_of(near, target.shape), 0), inside.astype(jnp.int32))
        return jnp.where(inside > 0, target.table.at[place].get(mode="promise_in_bounds"), nothing)

    lists = target.lists
    if neighbours == 1 and lists is None:
        return numbered(OFFSETS[1][0])
    best, slot = jnp.full(away.shape[1:], jnp.inf, away.dtype), jnp.full(away.shape[1:], nothing, jnp.int32)
    for offset in OFFSETS[neighbours]:
        found = numbered(offset)
        found, distance = _squared(target, found, away) if lists is None else _first(target, lists[found], away)
        slot = jnp.where(distance < best, found, slot)
        best = jnp.minimum(best, distance)
    return slot


def _squared(
    target: DistributionMap, slot: Int[Array, " n"], away: Float[Array, "3 n"]
) -> tuple[Int[Array, " n"], Float[Array, " n"]]:
    """The rows `slot`, and the squared distances from their means; inf where there is no distribution."""
    row = target.rows[slot].T
    return slot, jnp.where(row[9] > 0, jnp.sum((row[:3] - away) ** 2, axis=0), jnp.inf)


def _first(
    target: DistributionMap, rows: Int[Array, "n s"], away: Float[Array, "3 n"]
) -> tuple[Int[Array, " n"], Float[Array, " n"]]:
    """The nearest one of the rows listed for each point, and its squared distance."""
    apart = target.rows[:, :3][rows] - away.T[:, None, :]
    squared = jnp.where(rows < target.rows.shape[0] - 1, jnp.sum(apart**2, axis=-1), jnp.inf)
    pick = jnp.argmin(squared, axis=1)[:, None]
    return jnp.take_along_axis(rows, pick, axis=1)[:, 0], jnp.take_along_axis(squared, pick, axis=1)[:, 0]
