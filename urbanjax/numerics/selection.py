"""The k smallest of many numbers, exactly, on arrays of static shape: a reduction whose values are sorted lists.

`lax.top_k` sorts row by row and costs tens of nanoseconds per number on a CPU. Two sorted lists of k merge into the k
smallest of both by a fixed network of comparisons; that is associative, so a reduction over it runs anywhere.
"""

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Float, Int

# Lists that a reduction starts from. More than 15 slices of the keys, and XLA computes them once instead of in each.
TOGETHER = 16


def smallest(keys: Float[Array, "*n c"], k: int) -> list[Float[Array, "*n"]]:
    """The k smallest of the C keys, ascending; inf where there are fewer. Not differentiable; keys must not be NaN.

    Args: keys [*n, C]; k, how many.
    """
    none = jnp.asarray(jnp.inf, keys.dtype)
    count = -(-keys.shape[-1] // TOGETHER)
    spare = [(0, 0)] * (keys.ndim - 1) + [(0, count * TOGETHER - keys.shape[-1])]
    keys = jnp.pad(keys, spare, constant_values=jnp.inf)
    lists = _sorted([keys[..., i * count : (i + 1) * count] for i in range(TOGETHER)])[:k]
    lists += [jnp.broadcast_to(none, lists[0].shape)] * (k - len(lists))

    def merge(a: tuple[Array, ...], b: tuple[Array, ...]) -> tuple[Array, ...]:
        # Each of the k smallest is in one of these pairs (Batcher 1968).
        return tuple(_unfolded([_compared(a[i], b[k - 1 - i])[0] for i in range(k)]))

    return list(lax.reduce(tuple(lists), (none,) * k, merge, (keys.ndim - 1,)))


def tagged(values: Float[Array, "*n"], tags: Int[Array, "*n"], *, bits: int) -> Float[Array, "*n"]:
    """Keys that sort as the values do and carry a tag in the last `bits` bits of the mantissa.

    Args: values [*n], not negative; they are rounded down to what the bits leave, and inf counts as the largest number;
    tags [*n], in [0, 2^bits); bits, how many.
    """
    info, word = jnp.finfo(values.dtype), _word(values)
    # Away from zero, where the tag alone would be a denormal number, which some devices flush to zero.
    raw = lax.bitcast_convert_type(jnp.clip(values, info.tiny * 2.0 ** (bits + 1), info.max), word)
    return lax.bitcast_convert_type((raw & ~((1 << bits) - 1)) | tags.astype(word), values.dtype)


def untagged(keys: Float[Array, "*n"], bits: int) -> tuple[Float[Array, "*n"], Int[Array, "*n"]]:
    """The values, rounded down, and the tags of keys; of keys that stand for inf, inf and a tag without meaning.

    Args: keys [*n], as from `tagged`; bits, of the tag.
    """
    word, low = _word(keys), (1 << bits) - 1
    raw = lax.bitcast_convert_type(keys, word)
    largest = lax.bitcast_convert_type(jnp.asarray(jnp.finfo(keys.dtype).max, keys.dtype), word) & ~low
    values = lax.bitcast_convert_type(raw & ~low, keys.dtype)
    return jnp.where((raw & ~low) >= largest, jnp.inf, values), (raw & low).astype(jnp.int32)


def _word(values: Array) -> type:
    return jnp.int64 if values.dtype.itemsize == 8 else jnp.int32


def _compared(a: Array, b: Array) -> tuple[Array, Array]:
    """The smaller and the larger one. Not by `minimum`, which takes care of NaN at a price."""
    first = lax.lt(a, b)
    return lax.select(first, a, b), lax.select(first, b, a)


def _unfolded(values: list[Array]) -> list[Array]:
    """Ascending order of a list that rises and then falls."""
    n = len(values)
    if n == 1:
        return values
    half = 1 << (n - 1).bit_length() - 1
    # As if numbers below all others filled the list up to a power of two: those need no comparing.
    pairs = [_compared(values[i], values[half + i]) for i in range(n - half)]
    low, high = [pair[0] for pair in pairs], [pair[1] for pair in pairs] + values[n - half : half]
    return _unfolded(low) + _unfolded(high)


def _sorted(values: list[Array]) -> list[Array]:
    """Ascending order of a power of two of numbers, by Batcher's odd-even merge sort."""
    half = len(values) // 2
    return _joined(_sorted(values[:half]), _sorted(values[half:])) if half else values


def _joined(a: list[Array], b: list[Array]) -> list[Array]:
    if len(a) == 1:
        return list(_compared(a[0], b[0]))
    even, odd = _joined(a[::2], b[::2]), _joined(a[1::2], b[1::2])
    pairs = [_compared(x, y) for x, y in zip(odd, even[1:], strict=False)]
    return [even[0], *(x for pair in pairs for x in pair), odd[-1]]
