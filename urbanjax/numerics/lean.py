"""Operations of `jax.numpy` with equal results that trace to fewer equations.

The stack is one program of thousands of equations, each of which is traced, lowered and compiled. Their namesakes are
wrapped in programs of their own, convert what is given as a Python number, and provide for negative indices.
"""

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Bool, Int, Num


def where(condition: Bool[Array, "*s"], x: Num[Array, "*s"], otherwise: float | Num[Array, "..."]) -> Num[Array, "*s"]:
    """`jnp.where` for x of the condition's shape. Args: otherwise, of that shape too or a number."""
    if isinstance(otherwise, Array) and otherwise.shape == x.shape:
        return lax.select(condition, x, otherwise.astype(x.dtype))
    return lax.select(condition, x, lax.full_like(x, otherwise))


def clip(
    x: Num[Array, "*s"], low: float | int | Num[Array, "..."], high: float | int | Num[Array, "..."]
) -> Num[Array, "..."]:
    """`jnp.clip`."""
    return jnp.minimum(jnp.maximum(x, low), high)


def rows(values: Num[Array, "n *c"], index: Int[Array, "*q"]) -> Num[Array, "..."]:
    """`values[index]` for indices that are known to lie within 0 and n - 1."""
    return values.at[index].get(mode="promise_in_bounds", wrap_negative_indices=False)
