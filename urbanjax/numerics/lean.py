"""Operations of `jax.numpy` with equal results that trace to fewer equations.

The stack is one program of thousands of equations, each of which is traced, lowered and compiled. Their namesakes are
wrapped in programs of their own, convert what is given as a Python number, and provide for negative indices.
"""

import functools
import operator
from collections.abc import Callable
from typing import TypeGuard

import jax
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


def maximum(x: float | int | Num[Array, "..."], y: float | int | Num[Array, "..."]) -> Num[Array, "..."]:
    """`jnp.maximum`, with the derivative of x where both are equal.

    `jnp.maximum` halves it there, for which it compares both with the result, in a dozen equations of a gradient.
    Args: x and y, numbers or of shapes that broadcast.
    """
    if not _real(x):
        return jnp.maximum(x, y)
    return _at_least(x, y) if isinstance(y, float | int) else _greater(*_alike(x, y))


def minimum(x: float | int | Num[Array, "..."], y: float | int | Num[Array, "..."]) -> Num[Array, "..."]:
    """`jnp.minimum`, with the derivative of x where both are equal; see `maximum`.

    Args: x and y, numbers or of shapes that broadcast.
    """
    if not _real(x):
        return jnp.minimum(x, y)
    return _at_most(x, y) if isinstance(y, float | int) else _smaller(*_alike(x, y))


def clip(
    x: Num[Array, "*s"], low: float | int | Num[Array, "..."], high: float | int | Num[Array, "..."]
) -> Num[Array, "..."]:
    """`jnp.clip`, with derivative 1 at both ends, where that has a half.

    Args: x [*s]; low and high, numbers or of shapes that broadcast.
    """
    if _real(x) and isinstance(low, float | int) and isinstance(high, float | int):
        return _held(x, low, high)
    return minimum(maximum(x, low), high)


def _real(x: float | int | Array) -> TypeGuard[Array]:
    return isinstance(x, Array) and jnp.issubdtype(x.dtype, jnp.floating)


def _alike(*operands: Array) -> list[Array]:
    dtype = jnp.result_type(*operands)
    shape = jnp.broadcast_shapes(*(jnp.shape(each) for each in operands))
    return [jnp.broadcast_to(jnp.asarray(each, dtype), shape) for each in operands]


@functools.partial(jax.custom_jvp, nondiff_argnums=(1, 2))
def _held(x: Array, low: float | int, high: float | int) -> Array:
    return jnp.minimum(jnp.maximum(x, low), high)


@_held.defjvp
def _held_jvp(
    low: float | int, high: float | int, primals: tuple[Array], tangents: tuple[Array]
) -> tuple[Array, Array]:
    (x,), (change,) = primals, tangents
    return _held(x, low, high), where((x >= low) & (x <= high), change, 0.0)


def _beside_number(take: Callable[..., Array], keeps: Callable[..., Array]) -> Callable[..., Array]:
    """`take(x, y)` of a number y, with the derivative of x where `keeps(x, y)`."""

    @functools.partial(jax.custom_jvp, nondiff_argnums=(1,))
    def taken(x: Array, y: float | int) -> Array:
        return take(x, y)

    @taken.defjvp
    def _(y: float | int, primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
        (x,), (change,) = primals, tangents
        return taken(x, y), where(keeps(x, y), change, 0.0)

    return taken


def _of_two(take: Callable[..., Array], keeps: Callable[..., Array]) -> Callable[..., Array]:
    """`take(x, y)` of arrays of one shape, with the derivative of x where `keeps(x, y)` and of y elsewhere."""

    @jax.custom_jvp
    def taken(x: Array, y: Array) -> Array:
        return take(x, y)

    @taken.defjvp
    def _(primals: tuple[Array, Array], tangents: tuple[Array, Array]) -> tuple[Array, Array]:
        return taken(*primals), lax.select(keeps(*primals), *tangents)

    return taken


_at_least, _at_most = _beside_number(jnp.maximum, operator.ge), _beside_number(jnp.minimum, operator.le)
_greater, _smaller = _of_two(jnp.maximum, operator.ge), _of_two(jnp.minimum, operator.le)


def argmin(x: Num[Array, "*b n"]) -> Int[Array, "*b"]:
    """`jnp.argmin` over the last axis, several times as fast on a CPU. Args: x [*b, n], none of it nan."""
    # As it stands in memory: computed anew for each use, with different rounding, the least would not be found.
    x = lax.optimization_barrier(lax.stop_gradient(x))
    number = lax.broadcasted_iota(jnp.int32, x.shape, x.ndim - 1)
    return jnp.min(jnp.where(x <= jnp.min(x, axis=-1, keepdims=True), number, x.shape[-1] - 1), axis=-1)


def running_sum(x: Float[Array, "*b n"]) -> Float[Array, "*b m"]:
    """Sums of the first 0 .. n of a few entries: as a product, where `jnp.cumsum` becomes several loops on a CPU.

    Args: x [*b, n].
    """
    first = np.triu(np.ones((x.shape[-1], x.shape[-1] + 1), x.dtype), k=1)
    return jnp.matmul(x, first, precision=lax.Precision.HIGHEST)


def rows(values: Num[Array, "n *c"], index: Int[Array, "*q"]) -> Num[Array, "..."]:
    """`values[index]` for indices that are known to lie within 0 and n - 1. Args: values [n, *c]; index [*q]."""
    return values.at[index].get(mode="promise_in_bounds", wrap_negative_indices=False)
