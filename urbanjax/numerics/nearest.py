"""The k nearest neighbours among many points, with a certificate for each, in time linear in their number.

Groups of query points go down the tree of the points together: from the top down each group looks at the groups
nearest to it, among the parts of those that its parent looks at.
"""

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Bool, Float, Int

from urbanjax.numerics import tree as trees
from urbanjax.numerics.once import once
from urbanjax.numerics.selection import smallest, tagged, untagged
from urbanjax.numerics.tree import FAN, Tree, at
from urbanjax.types import pytree

WIDE = 31  # groups that those above the smallest look at, or more: what they miss, none below them can find
SHARE = 64  # groups of sixteen points that are searched for at once: what they need fits a cache


@pytree
class Neighbours:
    """The k nearest valid points of each of N points, itself included, nearest first. Points are in sorted order."""

    order: Array  # [N] int32, the points along the curve, invalid ones last
    index: Array  # [k, N] int32, places along the curve; the point's own where there are fewer than k
    squared: Array  # [k, N] squared distance, rounded down, by 1e-5 of it at the default visits; inf where missing
    exact: Array  # [N] bool: no point that was not looked at can be nearer


def nearest(points: Float[Array, "d n"], valid: Bool[Array, " n"], *, k: int, visits: int = 24) -> Neighbours:
    """The k nearest valid points of each point. Not differentiable.

    Where `exact` is false the neighbours are near ones, but perhaps not the nearest; more visits mend it.
    Args: points [d, N]; valid [N], points that count; k, how many; visits, groups of four points that each group looks
    at; more than some dozens take long to compile.
    """
    n = points.shape[1]
    tree = trees.build(points, valid, levels=trees.depth(n))
    index, squared, exact = (x[..., :n] for x in by_groups(tree, tree, k=k, visits=visits, same=True))
    index = jnp.where(jnp.isfinite(squared), index, jnp.arange(n, dtype=jnp.int32)[None])
    return Neighbours(order=tree.order, index=index, squared=squared, exact=exact)


def by_groups(own: Tree, other: Tree, *, k: int, visits: int, same: bool = False) -> tuple[Array, Array, Array]:
    """Places in `other` [k, M], squared distances [k, M] and certificates [M] for the M points of `own`.

    Squared distances are inf where there are fewer than k points.
    Args: own, a tree with as many levels as `other`; k, how many; visits, groups that each group looks at; same,
    whether both are one tree.
    """
    boxes, near, beyond = _parents(own, other, visits, same)
    parents = near.shape[0]
    share = min(SHARE, parents)

    def search(step: Array, found: tuple[Array, Array, Array]) -> tuple[Array, ...]:
        first = jnp.minimum(step * share, parents - share)
        mine, looks, limit = (lax.dynamic_slice_in_dim(x, first, share) for x in (boxes, near, beyond))
        groups, limit = narrowed(
            mine, other.levels[0], near=looks, beyond=limit, width=visits, first=first if same else None
        )
        points = lax.dynamic_slice_in_dim(own.leaves, first * FAN, share * FAN)
        index, squared = nearest_of(points, other.leaves, near=groups, k=k)
        place, exact = first * FAN**2, (squared[-1].reshape(-1, FAN) <= limit[:, None]).reshape(-1)
        return tuple(
            lax.dynamic_update_slice_in_dim(all_, some, place, axis=-1)
            for all_, some in zip(found, (index, squared, exact), strict=True)
        )

    # Invalid points are the last ones: what is spent on capacity stops with the valid ones.
    steps = -(-own.count // (share * FAN**2))
    size = own.leaves.shape[0] * FAN
    nothing = (
        jnp.zeros((k, size), jnp.int32),
        jnp.full((k, size), jnp.inf, own.leaves.dtype),
        jnp.zeros(size, bool),
    )
    return lax.fori_loop(0, steps, search, nothing)


def _parents(own: Tree, other: Tree, visits: int, same: bool) -> tuple[Array, Int[Array, "p v"], Float[Array, " p"]]:
    """The boxes of the groups of points by their parents, the groups that each parent looks at, and how far it sees."""
    all_, top = own.levels[-1].shape[0], other.levels[-1].shape[0]
    near = jnp.broadcast_to(jnp.arange(top, dtype=jnp.int32), (all_, top))
    beyond = jnp.full(all_, jnp.inf, own.leaves.dtype)
    for mine, boxes in zip(own.levels[:0:-1], other.levels[:0:-1], strict=True):
        near, beyond = narrowed(
            mine, boxes, near=near, beyond=beyond, width=max(visits, WIDE), first=0 if same else None
        )
    return own.levels[0], near, beyond


def narrowed(
    own: Float[Array, "p b f"],
    boxes: Float[Array, "q b c"],
    *,
    near: Int[Array, "p v"],
    beyond: Float[Array, " p"],
    width: int,
    first: int | Array | None = None,
) -> tuple[Int[Array, "g w"], Float[Array, " g"]]:
    """The W groups nearest to each part of some parents, of those that are parts of what the parent looks at.

    Returns also the squared distance within which no other group has a point.
    Args: own [P, b, f], boxes of the parts of P parents; boxes [Q, b, c], of the parts of the others; near [P, V],
    others that each parent looks at; beyond [P], squared distance within which it misses none; width W; first, number
    of the first parent where own parts are among the others.
    """
    number = parts_of(near)
    parts = own.shape[-1]
    if width >= number.shape[1]:
        return jnp.repeat(number, parts, axis=0), jnp.repeat(beyond, parts)
    apart = gaps_between(own, at(boxes, near))
    floor = 2**20 * jnp.finfo(apart.dtype).tiny  # above the key that `tagged` makes of 0
    if first is not None:
        # Boxes may overlap so much that many are apart by nothing; a group looks at itself first.
        me = first * FAN + jnp.arange(own.shape[0] * parts, dtype=jnp.int32).reshape(-1, parts, 1)
        apart = jnp.where(number[:, None, :] == me, 0, jnp.maximum(apart, floor))
    found, pick = _closest(apart, width + 1)
    pick = jnp.stack(pick[:width], axis=-1)
    chosen = jnp.take_along_axis(number[:, None, :], pick, axis=2, mode="clip").reshape(-1, width)
    return chosen, jnp.minimum(beyond[:, None], found[width]).reshape(-1)


def nearest_of(
    own: Float[Array, "g d f"], leaves: Float[Array, "h d c"], *, near: Int[Array, "g v"], k: int
) -> tuple[Int[Array, "k n"], Float[Array, "k n"]]:
    """Places and squared distances of the k points nearest to each point of some groups, in the groups looked at.

    Args: own [G, d, f], points of G groups; leaves [H, d, c], all others by groups; near [G, V], groups looked at; k,
    how many.
    """
    found, pick = _closest(between(own, at(leaves, near)), k)
    number = parts_of(near)
    row = jnp.arange(number.shape[0], dtype=jnp.int32)[None, :, None] * number.shape[1]
    return at(number.reshape(-1), row + jnp.stack(pick)).reshape(k, -1), jnp.stack(found).reshape(k, -1)


def gaps_between(own: Float[Array, "g b f"], others: Float[Array, "g v b h"]) -> Float[Array, "g f c"]:
    """Squared distances between the parts of each group and the C = V * H parts of the groups it looks at.

    Args: own [G, 2 d, f], boxes as (low, -high); others [G, V, 2 d, H], likewise.
    """
    g, b, f = own.shape
    d = b // 2
    total = jnp.zeros((), own.dtype)
    for i in range(d):
        here, there = own[:, :, :, None, None], others[:, None]
        gap = jnp.maximum(there[:, :, :, i] + here[:, d + i], here[:, i] + there[:, :, :, d + i])
        total = total + jnp.maximum(gap, 0) ** 2
    return total.reshape(g, f, -1)


def between(own: Float[Array, "g d f"], others: Float[Array, "g v d h"]) -> Float[Array, "g f c"]:
    """Squared distances between the points of each group and the C = V * H points of the groups it looks at.

    Args: own [G, d, f], points; others [G, V, d, H], points.
    """
    g, d, _ = own.shape
    own = jnp.where(jnp.isfinite(own), own, 0)
    # All points looked at in one row, else no loop over them is one of vector operations.
    rows = once(*(others[:, :, i].reshape(g, -1) for i in range(d)))
    gaps = [own[:, i, :, None] - rows[i][:, None] for i in range(d)]
    return sum((gap * gap for gap in gaps[1:]), gaps[0] * gaps[0])


def _closest(squared: Float[Array, "g f c"], k: int) -> tuple[list[Array], list[Array]]:
    """The k smallest distances, and which of the C they are; k arrays each."""
    bits = max((squared.shape[-1] - 1).bit_length(), 1)
    keys = smallest(tagged(squared, lax.broadcasted_iota(jnp.int32, squared.shape, 2), bits=bits), k)
    pairs = [untagged(key, bits) for key in keys]
    return [pair[0] for pair in pairs], [pair[1] for pair in pairs]


def parts_of(near: Int[Array, "g v"]) -> Int[Array, "g c"]:
    """The numbers of the C = V * FAN parts of the groups looked at. Args: near [G, V], numbers of groups."""
    return (near[:, :, None] * FAN + jnp.arange(FAN, dtype=jnp.int32)[None, None]).reshape(near.shape[0], -1)
