"""The k nearest neighbours among many points, with a certificate for each, in time linear in their number.

The points are sorted along a space-filling curve and cut into groups of four, those into groups of sixteen, and so on:
a tree without pointers, which adapts to the density of the points. From the top down each group looks at the groups
nearest to it, among the parts of those that its parent looks at. All of it is dense arithmetic on arrays of static
shape.
"""

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Bool, Float, Int, Shaped

from urbanjax.numerics import hilbert
from urbanjax.numerics.selection import smallest, tagged, untagged
from urbanjax.types import pytree

FAN = 4  # parts of a group
WIDE = 31  # groups that those above the smallest look at, or more: what they miss, none below them can find
SHARE = 64  # groups of sixteen points that are searched for at once: what they need fits a cache
TOP = 256  # groups up to which all look at all


@pytree
class Neighbours:
    """The k nearest valid points of each of N points, itself included, nearest first. Points are in sorted order."""

    order: Array  # [N] int32, the points along the curve, invalid ones last
    index: Array  # [k, N] int32, places along the curve; the point's own where there are fewer than k
    squared: Array  # [k, N] squared distance, rounded down, by 1e-5 of it at the default visits; inf where missing
    exact: Array  # [N] bool: no point that was not looked at can be nearer


def nearest(points: Float[Array, "d n"], valid: Bool[Array, " n"], k: int, visits: int = 24) -> Neighbours:
    """The k nearest valid points of each point. Not differentiable.

    Where `exact` is false the neighbours are near ones, but perhaps not the nearest; more visits mend it. Args: visits,
    groups of four points that each group looks at; more than some dozens take long to compile.
    """
    d, n = points.shape
    order = hilbert.order(points, valid)
    count = _groups(n)
    flat = jnp.pad(jnp.where(valid[None], points, jnp.inf), ((0, 0), (0, 1)), constant_values=jnp.inf).reshape(-1)
    places = jnp.pad(order, (0, count * FAN - n), constant_values=n).reshape(count, 1, FAN)
    leaves = _at(flat, places + (jnp.arange(d, dtype=jnp.int32) * (n + 1))[None, :, None])
    boxes, near, beyond = _parents(leaves, visits)
    parents = near.shape[0]
    share = min(SHARE, parents)

    def search(step: Array, found: tuple[Array, Array, Array]) -> tuple[Array, ...]:
        at = jnp.minimum(step * share, parents - share)
        own, looks, limit = (lax.dynamic_slice_in_dim(x, at, share) for x in (boxes, near, beyond))
        groups, limit = _narrowed(own, at, boxes, looks, limit, visits)
        points = lax.dynamic_slice_in_dim(leaves, at * FAN, share * FAN)
        index, squared = _nearest_of(points, leaves, groups, k)
        place, exact = at * FAN**2, (squared[-1].reshape(-1, FAN) <= limit[:, None]).reshape(-1)
        return tuple(
            lax.dynamic_update_slice_in_dim(all_, some, place, axis=-1)
            for all_, some in zip(found, (index, squared, exact), strict=True)
        )

    # Invalid points are the last ones: what is spent on capacity stops with the valid ones.
    steps = -(-jnp.sum(valid, dtype=jnp.int32) // (share * FAN**2))
    nothing = (
        jnp.zeros((k, count * FAN), jnp.int32),
        jnp.full((k, count * FAN), jnp.inf, points.dtype),
        jnp.zeros(count * FAN, bool),
    )
    index, squared, exact = (x[..., :n] for x in lax.fori_loop(0, steps, search, nothing))
    index = jnp.where(jnp.isfinite(squared), index, jnp.arange(n, dtype=jnp.int32)[None])
    return Neighbours(order=order, index=index, squared=squared, exact=exact)


def _groups(points: int) -> int:
    """Groups of FAN points in a tree without gaps."""
    size = FAN
    while points > TOP * size:
        size *= FAN
    return -(-points // (size * FAN)) * size


def _parents(leaves: Float[Array, "g d f"], visits: int) -> tuple[Array, Int[Array, "p v"], Float[Array, " p"]]:
    """The boxes of the groups of points by their parents, the groups that each parent looks at, and how far it sees."""
    # Boxes are kept as (low, -high), so that the box around boxes is their minimum, and a missing one is inf.
    levels = [_boxes(jnp.concatenate([leaves, jnp.where(jnp.isfinite(leaves), -leaves, jnp.inf)], axis=1))]
    while levels[-1].shape[0] * FAN > TOP:
        levels.append(_boxes(levels[-1]))
    top = levels[-1].shape[0]
    near = jnp.broadcast_to(jnp.arange(top, dtype=jnp.int32), (top, top))
    beyond = jnp.full(top, jnp.inf, leaves.dtype)
    for boxes in levels[:0:-1]:
        near, beyond = _narrowed(boxes, 0, boxes, near, beyond, max(visits, WIDE))
    return levels[0], near, beyond


def _narrowed(
    own: Float[Array, "p b f"],
    first: int | Array,
    boxes: Float[Array, "q b f"],
    near: Int[Array, "p v"],
    beyond: Float[Array, " p"],
    width: int,
) -> tuple[Int[Array, "g w"], Float[Array, " g"]]:
    """The W groups nearest to each part of some parents, of those that are parts of what the parent looks at.

    Returns also the squared distance within which no other group has a point. Args: first, number of the first parent.
    """
    number = _parts(near)
    if width >= number.shape[1]:
        return jnp.repeat(number, FAN, axis=0), jnp.repeat(beyond, FAN)
    apart = _apart(own, _at(boxes, near))
    # Boxes may overlap so much that many are apart by nothing; a group looks at itself first.
    me = first * FAN + jnp.arange(own.shape[0] * FAN, dtype=jnp.int32).reshape(-1, FAN, 1)
    apart = jnp.where(number[:, None, :] == me, 0, jnp.maximum(apart, 2**20 * jnp.finfo(apart.dtype).tiny))
    found, pick = _closest(apart, width + 1)
    pick = jnp.stack(pick[:width], axis=-1)
    chosen = jnp.take_along_axis(number[:, None, :], pick, axis=2, mode="clip").reshape(-1, width)
    return chosen, jnp.minimum(beyond[:, None], found[width]).reshape(-1)


def _nearest_of(
    own: Float[Array, "g d f"], leaves: Float[Array, "h d f"], near: Int[Array, "g v"], k: int
) -> tuple[Int[Array, "k n"], Float[Array, "k n"]]:
    """Places and squared distances of the k points nearest to each point of some groups, in the groups looked at."""
    found, pick = _closest(_between(own, _at(leaves, near)), k)
    number = _parts(near)
    row = jnp.arange(number.shape[0], dtype=jnp.int32)[None, :, None] * number.shape[1]
    return _at(number.reshape(-1), row + jnp.stack(pick)).reshape(k, -1), jnp.stack(found).reshape(k, -1)


def _boxes(parts: Float[Array, "g b f"]) -> Float[Array, "p b f"]:
    """The boxes around the parts of each group, as parts of the groups above."""
    g, b, f = parts.shape
    return jnp.min(jnp.swapaxes(parts.reshape(g // FAN, FAN, b, f), 1, 2), axis=-1)


def _apart(own: Float[Array, "g b f"], others: Float[Array, "g v b f"]) -> Float[Array, "g f c"]:
    """Squared distances between the parts of each group and the C = V * F parts of the groups it looks at."""
    g, b, f = own.shape
    d = b // 2
    total = jnp.zeros((), own.dtype)
    for i in range(d):
        here, there = own[:, :, :, None, None], others[:, None]
        gap = jnp.maximum(there[:, :, :, i] + here[:, d + i], here[:, i] + there[:, :, :, d + i])
        total = total + jnp.maximum(gap, 0) ** 2
    return total.reshape(g, f, -1)


def _between(own: Float[Array, "g d f"], others: Float[Array, "g v d f"]) -> Float[Array, "g f c"]:
    """Squared distances between the points of each group and the C = V * F points of the groups it looks at."""
    g, d, f = own.shape
    own = jnp.where(jnp.isfinite(own), own, 0)
    gaps = [own[:, i, :, None, None] - others[:, None, :, i] for i in range(d)]
    return sum((gap * gap for gap in gaps[1:]), gaps[0] * gaps[0]).reshape(g, f, -1)


def _closest(squared: Float[Array, "g f c"], k: int) -> tuple[list[Array], list[Array]]:
    """The k smallest distances, and which of the C they are; k arrays each."""
    bits = max((squared.shape[-1] - 1).bit_length(), 1)
    keys = smallest(tagged(squared, lax.broadcasted_iota(jnp.int32, squared.shape, 2), bits), k)
    pairs = [untagged(key, bits) for key in keys]
    return [pair[0] for pair in pairs], [pair[1] for pair in pairs]


def _parts(near: Int[Array, "g v"]) -> Int[Array, "g c"]:
    """The numbers of the C = V * FAN parts of the groups looked at."""
    return (near[:, :, None] * FAN + jnp.arange(FAN, dtype=jnp.int32)[None, None]).reshape(near.shape[0], -1)


def _at(table: Shaped[Array, "n *s"], index: Int[Array, "*m"]) -> Array:
    """Rows of a table, without the checks for places outside it."""
    return table.at[index].get(mode="clip", wrap_negative_indices=False)
