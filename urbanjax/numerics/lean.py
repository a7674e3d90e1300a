"""Operations of `jax.numpy` with equal results that trace to fewer equations.

The stack is one program of thousands of equations, each of which is traced, lowered and compiled. Their namesakes are
wrapped in programs of their own, convert what is given as a Python number, and provide for negative indices.
"""

import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jaxtyping import Bool, Float, Int, Num


def where(condition: Bool[Array, "*s"], x: Num[Array, "*s"], otherwise: float | Num[Array, "..."]) -> Num[Array, "*s"]:
    """`jnp.where` for x of the condition's shape.

    Args: condition [*s]; x [*s]; otherwise, of that shape too or a number.
    """
    if isinstance(otherwise, Array) and otherwise.shape == x.shape:
        return lax.select(condition, x, otherwise.astype(x.dtype))
    return lax.select(condition, x, lax.full_like(x, otherwise))


def clip(
    x: Num[Array, "*s"], low: float | int | Num[Array, "..."], high: float | int | Num[Array, "..."]
) -> Num[Array, "..."]:
    """`jnp.clip`. Args: x [*s]; low and high, numbers or of shapes that broadcast."""
    return jnp.minimum(jnp.maximum(x, low), high)


def running_sum(x: Float[Array, "*b n"]) -> Float[Array, "*b m"]:
    """Sums of the first 0 .. n of a few entries: as a product, where `jnp.cumsum` becomes several loops on a CPU.

    Args: x [*b, n].
    """
    first = np.triu(np.ones((x.shape[-1], x.shape[-1] + 1), x.dtype), k=1)
    return jnp.matmul(x, first, precision=lax.Precision.HIGHEST)


def rows(values: Num[Array, "n *c"], index: Int[Array, "*q"]) -> Num[Array, "..."]:
    """`values[index]` for indices that are known to lie within 0 and n - 1. Args: values [n, *c]; index [*q]."""
    return values.at[index].get(mode="promise_in_bounds", wrap_negative_indices=False)
