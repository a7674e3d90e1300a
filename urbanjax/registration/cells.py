"""Which points share a cell of an unbounded grid, by hashing: exact, whatever collides."""

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Bool, Float, Int

PRIMES = (73856093, 19349669, 83492791)  # Teschner et al. 2003
FOLD = 15  # bits by which a hash is shifted onto itself: its low bits, the slot, then depend on the high ones too
BATCH = 8  # share of the points that is looked at again at once, after a collision
STRIDE = 32  # places that one row of the sums holds


def representatives(cell: Int[Array, "3 n"], valid: Bool[Array, " n"]) -> Int[Array, " n"]:
    """For each point the index of one point of its cell, the same for all of them; N for invalid points.

    Open addressing, all points at once: each claims the slot of its hash, and the first point of those that claim a
    slot gets it for its cell. The few points of other cells go on to the next slots, in batches of static size. Args:
    cell [3, N], the points' cells; valid [N] bool.
    """
    n = cell.shape[1]
    slots = 1 << (n + n // 2).bit_length()  # half as many again, so that a free slot is always near
    index = jnp.arange(n, dtype=jnp.int32)
    mixed = jnp.sum(cell * jnp.array(PRIMES, jnp.int32)[:, None], axis=0, dtype=jnp.int32)
    start = (mixed ^ (mixed >> FOLD)) & (slots - 1)
    owner = jnp.full(slots, n, jnp.int32).at[jnp.where(valid, start, slots)].min(index, mode="drop")
    first = jnp.where(valid, owner[start], n)
    waits = valid & ~_same(cell, first, cell)

    def unplaced(carry: tuple) -> Array:
        return jnp.any(carry[1])

    def place(carry: tuple) -> tuple:
        first, waits, owner = carry
        which = chosen(waits, -(-n // BATCH))
        there = jnp.minimum(which, n - 1)
        found, owner = _probe(cell, cell[:, there], start[there], which, owner)
        return first.at[which].set(found, mode="drop"), waits.at[which].set(False, mode="drop"), owner

    return lax.while_loop(unplaced, place, (first, waits, owner))[0]


def _probe(
    cell: Int[Array, "3 n"], own: Int[Array, "3 m"], slot: Int[Array, " m"], which: Int[Array, " m"], owner: Array
) -> tuple[Int[Array, " m"], Array]:
    """Representatives of the points `which` [M] (N for none), by way of the slots after theirs."""
    n, slots = cell.shape[1], owner.shape[0]

    def unplaced(carry: tuple) -> Array:
        return jnp.any(carry[2])

    def claim(carry: tuple) -> tuple:
        slot, found, waits, owner = carry
        slot = jnp.where(waits, (slot + 1) & (slots - 1), slot)
        free = waits & (owner[slot] == n)
        owner = owner.at[jnp.where(free, slot, slots)].min(which, mode="drop")
        held = owner[slot]
        same = waits & _same(cell, held, own)
        return slot, jnp.where(same, held, found), waits & ~same, owner

    _, found, _, owner = lax.while_loop(unplaced, claim, (slot, which, which < n, owner))
    return found, owner


def chosen(mask: Bool[Array, " n"], capacity: int) -> Int[Array, " capacity"]:
    """The indices of the first places where the mask is true; N for the rest of the capacity.

    Args: mask [N] bool; capacity, the size of the result.
    """
    n = mask.shape[0]
    place = jnp.where(mask, before(mask), capacity)
    return jnp.full(capacity, n, jnp.int32).at[place].set(jnp.arange(n, dtype=jnp.int32), mode="drop")


def before(mask: Bool[Array, " n"]) -> Int[Array, " n"]:
    """How many places before each one are true, for up to 2^24 places. Args: mask [N] bool."""
    return _sums_before(mask.astype(jnp.float32)).astype(jnp.int32)


def _sums_before(values: Float[Array, " n"]) -> Float[Array, " n"]:
    """Exclusive cumulative sums, by matrix products: XLA's own take six times as long on a CPU."""
    n = values.shape[0]
    rows = jnp.pad(values, (0, -n % STRIDE)).reshape(-1, STRIDE)
    earlier = jnp.triu(jnp.ones((STRIDE, STRIDE), values.dtype), 1)
    if n > STRIDE:
        rows = jnp.concatenate([rows, _sums_before(jnp.sum(rows, axis=1))[:, None]], axis=1)
        earlier = jnp.concatenate([earlier, jnp.ones((1, STRIDE), values.dtype)])
    return jnp.matmul(rows, earlier, precision=lax.Precision.HIGHEST).reshape(-1)[:n]


def _same(cell: Int[Array, "3 n"], which: Int[Array, " m"], own: Int[Array, "3 m"]) -> Bool[Array, " m"]:
    """Whether the cells of some points are the given ones; false for the point N, which there is not."""
    x, y, z = (
        row.at[which].get(mode="clip", wrap_negative_indices=False) == other
        for row, other in zip(cell, own, strict=True)
    )
    return (which < cell.shape[1]) & x & y & z
