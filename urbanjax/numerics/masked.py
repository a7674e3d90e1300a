"""Statistics over the last axis of the entries that count; 0, with derivative 0, where none does."""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int

from urbanjax.numerics import safe


def mean(x: Float[Array, "*b n"], mask: Bool[Array, "*b n"]) -> Float[Array, "*b"]:
    """Arithmetic mean. Args: x [*b, n]; mask [*b, n], entries that count."""
    total = jnp.sum(jnp.where(mask, x, 0), axis=-1)
    return safe.divide(total, jnp.sum(mask, axis=-1, dtype=x.dtype))


def deviation(x: Float[Array, "*b n"], mask: Bool[Array, "*b n"]) -> Float[Array, "*b n"]:
    """Each entry less the mean; 0 where it does not count. Args: x [*b, n]; mask [*b, n], entries that count."""
    return jnp.where(mask, jnp.where(mask, x, 0) - mean(x, mask)[..., None], 0)


def std(x: Float[Array, "*b n"], mask: Bool[Array, "*b n"]) -> Float[Array, "*b"]:
    """Standard deviation, divided by the number of entries (not by one less); derivative 0 where it is 0.

    Args: x [*b, n]; mask [*b, n], entries that count.
    """
    return safe.sqrt(mean(deviation(x, mask) ** 2, mask))


def rms(x: Float[Array, "*b n"], mask: Bool[Array, "*b n"]) -> Float[Array, "*b"]:
    """Root of the mean square; derivative 0 where it is 0. Args: x [*b, n]; mask [*b, n], entries that count."""
    return safe.sqrt(mean(jnp.where(mask, x, 0) ** 2, mask))


def largest(x: Float[Array, "*b n"], mask: Bool[Array, "*b n"]) -> Float[Array, "*b"]:
    """Largest entry, with the derivative of the first one on a tie.

    Args: x [*b, n]; mask [*b, n], entries that count.
    """
    at = jnp.argmax(jnp.where(mask, x, -jnp.inf), axis=-1)
    value = jnp.take_along_axis(x, at[..., None], axis=-1)[..., 0]
    return jnp.where(jnp.any(mask, axis=-1), value, 0)


def quantile(
    x: Float[Array, "*b n"], mask: Bool[Array, "*b n"], *, level: float | Float[Array, ""]
) -> Float[Array, "*b"]:
    """Quantile at a level in [0, 1], linear between order statistics (as `numpy.quantile` by default).

    Args: x [*b, n]; mask [*b, n], entries that count; level [], 0 to 1.
    """
    last = jnp.maximum(jnp.sum(mask, axis=-1, keepdims=True) - 1, 0)
    ordered = jnp.sort(jnp.where(mask, x, jnp.inf), axis=-1)
    place = level * last.astype(x.dtype)
    low = jnp.clip(jnp.floor(place).astype(jnp.int32), 0, last)
    below = jnp.take_along_axis(ordered, low, axis=-1)
    above = jnp.take_along_axis(ordered, jnp.minimum(low + 1, last), axis=-1)
    some = jnp.any(mask, axis=-1, keepdims=True)
    below, above = jnp.where(some, below, 0), jnp.where(some, above, 0)
    return (below + (place - low) * (above - below))[..., 0]


def latest(mask: Bool[Array, "*b n"]) -> Int[Array, "*b n"]:
    """Index of the last entry that counts at or before each; before the first of them that one, and 0 without any.

    Args: mask [*b, n], entries that count.
    """
    index = jnp.broadcast_to(jnp.arange(mask.shape[-1], dtype=jnp.int32), mask.shape)
    seen = jnp.where(mask, index, -1)
    first = jnp.argmax(mask, axis=-1, keepdims=True).astype(jnp.int32)
    return jnp.maximum(jax.lax.cummax(seen, axis=mask.ndim - 1), first)
