"""Functions of many alike things, whose derivative is computed tile by tile.

Forward, a compiler fuses a chain of operations into one loop, which reads its inputs and writes its result. Backward it
cannot: dozens of arrays of the full size are written and read again, and where they do not fit into the processor's
cache, that is all that a gradient waits for.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jax import Array, lax

from urbanjax.numerics.kept import kept

T = TypeVar("T")


def by_tiles(function: Callable[[Any, Any], T], shared: Any, *, rows: Any, size: int) -> T:
    """`function(shared, rows)`, each row of which depends on the same row alone.

    Its derivative, in both modes, goes from tile to tile and keeps nothing of them but what they are made of. Args:
    function, pure, of any number of rows; shared, what is the same for all; rows, a pytree of arrays with one first
    axis, and so is what comes out; size, rows of a tile.
    """

    @jax.custom_jvp
    def whole(shared: Any, rows: Any) -> T:
        return function(shared, rows)

    @whole.defjvp
    def _(primals: tuple, tangents: tuple) -> tuple[T, T]:
        def tiled(shared: Any, rows: Any) -> T:
            return in_tiles(jax.checkpoint(lambda tile: function(shared, tile)), rows, size=size)

        _, changes = jax.jvp(tiled, primals, tangents)
        values, (_, rows) = function(*primals), primals
        return kept(values) if _size(values) < _size(rows) else values, changes

    return whole(shared, rows)


def _size(tree: Any) -> int:
    return sum(leaf.size for leaf in jax.tree.leaves(tree))


def in_tiles(function: Callable[[Any], T], rows: Any, *, size: int) -> T:
    """`function(rows)`, tile after tile. Args: function, of any number of rows; rows, see `by_tiles`; size, at most."""
    count = jax.tree.leaves(rows)[0].shape[0]
    each = -(-count // -(-count // size))  # as few tiles as can be, filled evenly

    def split(x: Array) -> Array:
        filled = jnp.concatenate([x, jnp.repeat(x[-1:], -count % each, axis=0)]) if count % each else x
        return filled.reshape(-1, each, *x.shape[1:])

    found = lax.map(function, jax.tree.map(split, rows))
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:])[:count], found)
