"""A bound on what derivatives carry back through a point of a program."""

from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jax import Array

T = TypeVar("T")


@jax.custom_vjp
def clip_cotangent(values: T, most: Array | float) -> T:
    """The values; what reverse mode carries back through them has a norm of at most so much, over all of them.

    Through a long loop gradients can grow by a factor of hundreds in a step, and overflow; with this between its steps
    they keep their direction. A smaller one is exact; one that is not finite, or whose square is not, becomes NaN.
    Reverse mode only. Args: values, a pytree of arrays; most [], the norm.
    """
    return values


def _forward(values: T, most: Array | float) -> tuple[T, Array | float]:
    return values, most


def _backward(most: Array | float, carried: T) -> tuple[T, Array]:
    slopes = [x for x in jax.tree.leaves(carried) if _differentiable(x)]
    norm = jnp.sqrt(sum(jnp.sum(x * x) for x in slopes))
    share = jnp.where(jnp.isfinite(norm), most / jnp.maximum(norm, most), jnp.nan)
    return jax.tree.map(lambda x: x * share.astype(x.dtype) if _differentiable(x) else x, carried), jnp.zeros_like(most)


def _differentiable(cotangent: Any) -> bool:
    return cotangent.dtype != jax.dtypes.float0


clip_cotangent.defvjp(_forward, _backward)
