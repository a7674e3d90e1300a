"""Pytrees in tests."""

import jax
import jax.numpy as jnp


def float_leaves(tree):
    """The float leaves, and how to put others in their place."""
    leaves, structure = jax.tree.flatten(tree)
    where = [i for i, leaf in enumerate(leaves) if jnp.issubdtype(leaf.dtype, jnp.floating)]

    def back(floats):
        full = list(leaves)
        for i, leaf in zip(where, floats, strict=True):
            full[i] = leaf
        return jax.tree.unflatten(structure, full)

    return [leaves[i] for i in where], back
