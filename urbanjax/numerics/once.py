"""A hint to the compiler."""

import jax.numpy as jnp
from jax import Array
from jax.lax import optimization_barrier


def once(*arrays: Array) -> tuple[Array, ...]:
    """Arrays of one shape, computed once.

    The CPU compiler would otherwise fuse what they are made of into each of their users, and compute it anew there.
    Args: arrays, of one shape.
    """
    return jnp.unstack(optimization_barrier(jnp.stack(arrays)))
