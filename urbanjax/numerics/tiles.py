"""Functions of many alike things, computed tile by tile.

A chain of operations that does not become one loop writes and reads arrays of the full size, one after the other: where
they do not fit into the processor's cache, that is all that the function waits for.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, lax


def in_tiles(function: Callable[[Any], Any], rows: Any, *, size: int) -> Any:
    """`function(rows)`, each row of which depends on the same row alone, tile after tile.

    Args: function, of any number of rows; rows, a pytree of arrays with one first axis, and so is what comes out; size,
    rows of a tile, at most.
    """
    count = jax.tree.leaves(rows)[0].shape[0]
    each = -(-count // -(-count // size))  # as few tiles as can be, filled evenly

    def split(x: Array) -> Array:
        filled = jnp.concatenate([x, jnp.repeat(x[-1:], -count % each, axis=0)]) if count % each else x
        return filled.reshape(-1, each, *x.shape[1:])

    found = lax.map(function, jax.tree.map(split, rows))
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:])[:count], found)
