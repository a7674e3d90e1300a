"""Numbers for the cells of an unbounded grid, by hashing: points of one cell share a number, and no two cells do."""

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Bool, Int

PRIMES = (73856093, 19349669, 83492791)  # Teschner et al. 2003


def slots_for(points: int) -> int:
    """Size of the table for so many points: a power of two, half as many again, so that a free slot is always near."""
    return 1 << (points + points // 2).bit_length()


def number_cells(cell: Int[Array, "3 n"], valid: Bool[Array, " n"], slots: int) -> Int[Array, " n"]:
    """A number in [0, slots) for the cell of each point, `slots` for invalid points. Exact, whatever collides.

    Open addressing, all points at once: each claims the slot of its hash, the first point of those that claim a slot
    gets it for its cell, and the points of other cells go on to the next slot. Args: slots, see
    `slots_for`; with fewer than there are cells it would never end.
    """
    n = cell.shape[1]
    index = jnp.arange(n, dtype=jnp.int32)
    mixed = cell[0] * PRIMES[0] ^ cell[1] * PRIMES[1] ^ cell[2] * PRIMES[2]
    start = (mixed ^ (mixed >> 15)) & (slots - 1)

    def unplaced(carry: tuple) -> Array:
        return jnp.any(carry[2])

    def claim(carry: tuple) -> tuple:
        slot, owner, waits = carry
        # Slots with an owner hold index - n < 0, so that no later claim takes them.
        owner = owner.at[slot].min(jnp.where(waits, index, n))
        held = owner[slot]
        first = jnp.where(held < 0, held + n, held)
        same = jnp.all(cell == cell[:, first], axis=0)
        waits = waits & ~same
        owner = jnp.where((owner >= 0) & (owner < n), owner - n, owner)
        return jnp.where(waits, (slot + 1) & (slots - 1), slot), owner, waits

    empty = jnp.full(slots, n, jnp.int32)
    slot, _, _ = lax.while_loop(unplaced, claim, (start, empty, valid))
    return jnp.where(valid, slot, slots)
