"""Order along the Hilbert curve: points that follow one another lie close together in space."""

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Bool, Float, Int

WORD = 31  # bits of a sort key
CODE = 30  # bits of a code, at most


def order(points: Float[Array, "d n"], valid: Bool[Array, " n"], *, passes: int = 2) -> Int[Array, " n"]:
    """The indices [N] of points along the curve over their bounding cube; those of invalid points come last.

    Sorts of one word each, by parts of the code from the lowest upwards, with the index in the rest of the word:
    sorting pairs takes XLA five times as long. What the index leaves bounds the steps per axis: with two passes 1024
    for N up to 32768 in three dimensions, or for N up to a million in two.
    Args: points [d, N]; valid [N], points that count; passes, no more than 30 bits need.
    """
    d, n = points.shape
    index_bits = max((n - 1).bit_length(), 1)
    part = WORD - 1 - index_bits
    passes = min(passes, -(-CODE // part))
    bits = min(part * passes, CODE) // d
    low = jnp.min(jnp.where(valid[None], points, jnp.inf), axis=1, keepdims=True)
    high = jnp.max(jnp.where(valid[None], points, -jnp.inf), axis=1, keepdims=True)
    size = jnp.maximum(jnp.max(high - low), jnp.finfo(points.dtype).tiny)
    steps = jnp.where(valid[None], jnp.clip((points - low) / size * 2**bits, 0, 2**bits - 1), 0).astype(jnp.int32)
    code = code_of(steps, bits)
    index, ones = jnp.arange(n, dtype=jnp.int32), (1 << index_bits) - 1
    found = index
    for k in range(passes):
        key = (code >> (k * part)) & ((1 << part) - 1)
        if k == passes - 1:
            key = jnp.where(valid, key, 1 << part)
        found = found[lax.sort((key[found] << index_bits) | index) & ones]
    return found


def code_of(cell: Int[Array, "d n"], bits: int) -> Int[Array, " n"]:
    """The place of cells, of 2^bits along each axis, on the curve (Skilling 2004).

    Args: cell [d, n], not negative; bits, per axis.
    """
    x = list(cell)
    for bit in reversed(range(1, bits)):
        below = (1 << bit) - 1
        for i in range(len(x)):
            inverts, swap = (x[i] >> bit) & 1 == 1, (x[0] ^ x[i]) & below
            x[0] = jnp.where(inverts, x[0] ^ below, x[0] ^ swap)
            x[i] = x[i] if i == 0 else jnp.where(inverts, x[i], x[i] ^ swap)
    for i in range(1, len(x)):
        x[i] = x[i] ^ x[i - 1]
    flips = jnp.zeros_like(x[0])
    for bit in range(1, bits):
        flips = flips ^ jnp.where((x[-1] >> bit) & 1 == 1, (1 << bit) - 1, 0)
    x = jnp.stack(x) ^ flips[None]
    spread = jnp.zeros_like(x)
    for bit in range(bits):
        spread = spread | (((x >> bit) & 1) << (bit * len(x)))
    # A sum, which XLA computes once, where it would compute anew each term of an `or` for each use.
    return jnp.sum(spread << jnp.arange(len(x) - 1, -1, -1, dtype=jnp.int32)[:, None], axis=0, dtype=jnp.int32)
