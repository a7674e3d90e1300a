"""Exact k nearest neighbours among many points, with a certificate for each.

Points are sorted along a space-filling curve and cut into blocks; each block looks at the blocks nearest to it. All of
it is dense arithmetic on arrays of static shape, and adapts to the density of the points as a tree would.
"""

import jax
import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Bool, Float, Int

from urbanjax.types import pytree

BITS = 30  # of the curve, shared by the dimensions


@pytree
class Blocks:
    """N points in G blocks of B along a curve, and the V blocks that each looks at, nearest first, itself included."""

    order: Array  # [N] int32, point at each place of the curve
    place: Array  # [N] int32, place of each point
    position: Array  # [D, G, B]
    valid: Array  # [G, B] bool
    near: Array  # [G, V] int32
    beyond: Array  # [G] squared distance to the nearest block that is not looked at


@pytree
class Neighbours:
    """The k nearest points of each point, itself included."""

    index: Array  # [N, k] int32, nearest first
    squared: Array  # [N, k] squared distance; inf where there are fewer than k points
    exact: Array  # [N] bool: no point that was not looked at can be nearer


def curve(points: Float[Array, "d n"], valid: Bool[Array, " n"]) -> Int[Array, " n"]:
    """The place [N] of points along the Z-order curve over their bounding box; the last place for invalid ones."""
    bits = BITS // points.shape[0]
    low = jnp.min(jnp.where(valid[None], points, jnp.inf), axis=1, keepdims=True)
    high = jnp.max(jnp.where(valid[None], points, -jnp.inf), axis=1, keepdims=True)
    size = jnp.maximum(jnp.max(high - low), jnp.finfo(points.dtype).tiny)
    steps = jnp.where(valid[None], jnp.clip((points - low) / size * 2**bits, 0, 2**bits - 1), 0).astype(jnp.int32)
    code = jnp.zeros(points.shape[1:], jnp.int32)
    for bit in range(bits):
        for i, step in enumerate(steps):
            code = code | (((step >> bit) & 1) << (bit * len(steps) + i))
    return jnp.where(valid, code, jnp.iinfo(jnp.int32).max)


def arrange(points: Float[Array, "d n"], valid: Bool[Array, " n"], block: int, visits: int) -> Blocks:
    """The points in blocks. Args: block, points that go together; visits, blocks that each block looks at."""
    d, n = points.shape
    count = -(-n // block)
    visits = min(visits, count)
    index = jnp.arange(n, dtype=jnp.int32)
    _, order = lax.sort((curve(points, valid), index), num_keys=1)
    spare = count * block - n
    there = jnp.pad(valid[order], (0, spare)).reshape(count, block)
    position = jnp.pad(points[:, order], ((0, 0), (0, spare))).reshape(d, count, block)
    low = jnp.min(jnp.where(there[None], position, jnp.inf), axis=2)
    high = jnp.max(jnp.where(there[None], position, -jnp.inf), axis=2)
    # Kept apart from what follows, or each pair of blocks would compute its boxes anew.
    low, high = lax.optimization_barrier((low, high))
    apart = jnp.zeros((count, count), points.dtype)
    for a, b in zip(low, high, strict=True):
        between = jnp.maximum(a[None, :] - b[:, None], a[:, None] - b[None, :])
        apart = apart + jnp.maximum(between, 0) ** 2
    filled = jnp.any(there, axis=1)
    apart = jnp.where(filled[None, :] & filled[:, None], apart, jnp.inf)
    # Sliced right away, XLA would sort in full instead.
    nearness, near = lax.optimization_barrier(lax.top_k(-apart, min(visits + 1, count)))
    beyond = -nearness[:, visits] if visits < count else jnp.full(count, jnp.inf, points.dtype)
    place = jnp.zeros(n, jnp.int32).at[order].set(index)
    return Blocks(order, place, position, there, near[:, :visits], beyond)


def candidates(blocks: Blocks) -> Float[Array, "d g c"]:
    """The C = V * B points that each block looks at."""
    d, count, _ = blocks.position.shape
    return blocks.position[:, blocks.near].reshape(d, count, -1)


def distances(blocks: Blocks) -> Float[Array, "g b c"]:
    """Squared distance from each point of each block to its candidates; inf to invalid ones."""
    count = blocks.position.shape[1]
    squared = jnp.zeros((), blocks.position.dtype)
    for here, there in zip(blocks.position, candidates(blocks), strict=True):
        squared = squared + (here[:, :, None] - there[:, None, :]) ** 2
    # Kept apart from what follows, or each use would compute the distances anew.
    return lax.optimization_barrier(jnp.where(blocks.valid[blocks.near].reshape(count, 1, -1), squared, jnp.inf))


def reach(squared: Float[Array, "g b c"], k: int, steps: int = 12) -> Float[Array, "g b"]:
    """A squared distance [G, B] at which at least k candidates are as near, and for nearly all points exactly k.

    With too few candidates it is inf. Counting candidates at distances between two bounds, which close in by false
    position (on a surface the count grows with the squared distance), needs no sorting.
    """
    own = squared[..., : max(squared.shape[1], k)]  # of the point's own block: a bound close by
    finite = jnp.isfinite(own)
    close = jnp.max(jnp.where(finite, own, 0), axis=-1)
    far = jnp.max(jnp.where(jnp.isfinite(squared), squared, 0), axis=-1)

    def count(bound: Array) -> Array:
        return jnp.sum(squared <= bound[..., None], axis=-1, dtype=jnp.int32).astype(squared.dtype)

    def narrow(_: Array, bounds: tuple[Array, ...]) -> tuple[Array, ...]:
        low, high, few, many = bounds
        share = (k - 0.5 - few) / jnp.maximum(many - few, 1)
        middle = low + (high - low) * jnp.clip(share, 0.05, 0.95)
        found = count(middle)
        enough = found >= k
        return (
            jnp.where(enough, low, middle),
            jnp.where(enough, middle, high),
            jnp.where(enough, few, found),
            jnp.where(enough, found, many),
        )

    high = jnp.where(jnp.sum(finite, axis=-1) >= k, close, far)
    first = jnp.zeros_like(high), high, jnp.ones_like(high), count(high)
    _, high, _, _ = lax.fori_loop(0, steps, narrow, first)
    return jnp.where(jnp.sum(jnp.isfinite(squared), axis=-1) >= k, high, jnp.inf)


def nearest(
    points: Float[Array, "d n"], valid: Bool[Array, " n"], k: int, block: int = 16, visits: int = 16
) -> Neighbours:
    """The k nearest valid points of each valid point, itself included.

    Where `exact` is false (an uneven cloud, or too few visits), the neighbours are near ones but perhaps not the
    nearest: more visits or larger blocks mend it. The choice is not differentiable.
    """
    n = points.shape[1]
    blocks = arrange(points, valid, block, visits)
    found, pick = lax.top_k(-distances(blocks), k)
    squared = -found.reshape(-1, k)[:n]
    place = jnp.take_along_axis(blocks.near[:, None, :], pick // block, axis=2) * block + pick % block
    index = blocks.order[jnp.minimum(place.reshape(-1, k)[:n], n - 1)]
    exact = squared[:, -1] <= jnp.repeat(blocks.beyond, block)[:n]
    return jax.tree.map(lambda x: x[blocks.place], Neighbours(index, squared, exact))
