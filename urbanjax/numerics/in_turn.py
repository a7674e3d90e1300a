"""Batches computed one member after the other.

Where one member fills the processor's cache, a whole batch would be written to memory and read back by each operation.
One after the other also allows a loop to end when its own member needs no more.
"""

import functools
from collections.abc import Callable
from typing import Any

import jax
from jax.custom_batching import custom_vmap


def in_turn(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, which under `jax.vmap` on a CPU is computed for one member of the batch after the other.

    On another device batches are batches. Not for reverse mode: to be called where a derivative is given by hand.
    Args: function, of pytrees of arrays.
    """
    one = custom_vmap(function)

    @one.def_vmap
    def _(size: int, batched: list[Any], *args: Any) -> tuple[Any, Any]:
        if jax.default_backend() == "cpu":
            out = _one_by_one(one, args, batched)
        else:
            axes = jax.tree.map(lambda each: 0 if each else None, tuple(batched))
            out = jax.vmap(function, in_axes=axes, axis_size=size)(*args)
        return out, jax.tree.map(lambda _: True, out)

    return functools.wraps(function)(one)


def _one_by_one(function: Callable[..., Any], args: tuple[Any, ...], batched: list[Any]) -> Any:
    """The function of each member. Args: args; batched, which of their leaves have one for each member."""
    leaves, tree = jax.tree.flatten(args)
    each = jax.tree.leaves(batched)

    def member(own: list[jax.Array]) -> Any:
        following = iter(own)
        values = [next(following) if its else x for x, its in zip(leaves, each, strict=True)]
        return function(*jax.tree.unflatten(tree, values))

    return jax.lax.map(member, [x for x, its in zip(leaves, each, strict=True) if its])
