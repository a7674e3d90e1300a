"""The k nearest neighbours of every query, none of them in doubt.

Groups of queries are searched for together (`nearest`). Those whose certificate fails go down the tree alone, with a
box as small as a point. What even that leaves in doubt looks at everything that is nearer than what was found (far from
densely sampled curves that is much), and at the very last at every point.
"""

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Bool, Float, Int

from urbanjax.numerics import nearest as groups
from urbanjax.numerics import tree as trees
from urbanjax.numerics.tree import Tree, at

VISITS = 16  # groups of four points that each group of four queries looks at
ALONE = 32  # groups that a query alone looks at
NEARER = 128  # groups nearer than what was found that are looked at
BLOCK = 256  # queries that go down alone at once


def nearest_among(own: Tree, other: Tree, *, k: int) -> tuple[Int[Array, "k n"], Array]:
    """The k points [k, n] of `other` nearest to each point of `own`, nearest first, and how many were searched alone.

    Indices and columns count the points as they were given to `tree.build`; an index is `other`'s number of points
    where there are fewer than k, and for an invalid query. Of neighbours whose squared distances differ by less than
    1e-5 of them either may come first. Not differentiable.
    Args: own and other, trees of equal depth; k, how many.
    """
    n, m = own.order.shape[0], other.order.shape[0]
    index, squared, exact = groups.by_groups(own, other, k=k, visits=max(VISITS, -(-k // trees.FAN)))
    exact = exact | (jnp.arange(exact.shape[0]) >= own.count)
    points = jnp.swapaxes(own.leaves, 1, 2).reshape(-1, own.leaves.shape[1])
    index, squared, alone = _each(points, exact, other, k, index, squared)
    there = jnp.isfinite(squared[:, :n]) & (jnp.arange(n) < own.count)[None]
    found = jnp.where(there, at(other.order, index[:, :n]), m)
    return jnp.full((k, n), m, jnp.int32).at[:, own.order].set(found, unique_indices=True), alone


def _each(
    points: Float[Array, "q d"], exact: Bool[Array, " q"], other: Tree, k: int, index: Array, squared: Array
) -> tuple[Array, Array, Array]:
    """The neighbours with those in doubt found anew, query by query."""
    size = points.shape[0]
    doubt = jnp.nonzero(~exact, size=size, fill_value=size)[0].astype(jnp.int32)
    count = jnp.sum(~exact, dtype=jnp.int32)
    doubt = jnp.pad(doubt, (0, BLOCK), constant_values=size)

    def block(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        done, index, squared = state
        which = lax.dynamic_slice_in_dim(doubt, done, BLOCK)
        queries = at(points, which)
        found = _alone(queries, other, k)
        found = lax.cond(jnp.all(found[2]), lambda: found, lambda: _nearer(queries, other, k, *found))
        near, away = _compared_with_all(queries, found[2] | (which >= size), other, k, *found[:2])
        index, squared = (all_.at[:, which].set(some, mode="drop") for all_, some in ((index, near), (squared, away)))
        return done + BLOCK, index, squared

    _, index, squared = lax.while_loop(lambda state: state[0] < count, block, (jnp.int32(0), index, squared))
    return index, squared, count


def _alone(queries: Float[Array, "b d"], other: Tree, k: int) -> tuple[Array, Array, Array]:
    """Neighbours [k, B] of single queries, squared distances [k, B], and which are certain [B]."""
    box = jnp.concatenate([queries, -queries], axis=1)[:, :, None]
    top = other.levels[-1].shape[0]
    near = jnp.broadcast_to(jnp.arange(top, dtype=jnp.int32), (queries.shape[0], top))
    beyond = jnp.full(queries.shape[0], jnp.inf, queries.dtype)
    for boxes in other.levels[::-1]:
        near, beyond = groups.narrowed(box, boxes, near=near, beyond=beyond, width=max(ALONE, k))
    index, squared = groups.nearest_of(queries[:, :, None], other.leaves, near=near, k=k)
    return index, squared, squared[-1] <= beyond


def _nearer(
    queries: Float[Array, "b d"], other: Tree, k: int, index: Array, squared: Array, certain: Array
) -> tuple[Array, Array, Array]:
    """The same from all groups that may hold a point nearer than the k-th found; certain where those are few enough."""
    box = jnp.concatenate([queries, -queries], axis=1)[:, :, None]
    reach, rows = squared[-1] * (1 + 1e-4), queries.shape[0]  # what was found is rounded down
    top = other.levels[-1].shape[0]
    near = jnp.broadcast_to(jnp.arange(top, dtype=jnp.int32), (rows, top))
    there, few = jnp.ones((rows, top), bool), jnp.ones(rows, bool)
    for boxes in other.levels[::-1]:
        apart = groups.gaps_between(box, at(boxes, near))[:, 0]
        nearer = (apart <= reach[:, None]) & jnp.repeat(there, trees.FAN, axis=1)
        place = jnp.where(nearer, jnp.cumsum(nearer, axis=1, dtype=jnp.int32) - 1, NEARER)
        row = jnp.arange(rows, dtype=jnp.int32)[:, None]
        near = jnp.zeros((rows, NEARER), jnp.int32).at[row, place].set(groups.parts_of(near), mode="drop")
        count = jnp.sum(nearer, axis=1, dtype=jnp.int32)
        few, there = few & (count <= NEARER), jnp.arange(NEARER, dtype=jnp.int32)[None] < count[:, None]
    points = groups.between(queries[:, :, None], at(other.leaves, near))[:, 0]
    away, pick = lax.top_k(-jnp.where(jnp.repeat(there, trees.FAN, axis=1), points, jnp.inf), k)
    place = jnp.take_along_axis(groups.parts_of(near), pick, axis=1)
    better = (few & ~certain)[None]
    return jnp.where(better, place.T, index), jnp.where(better, -away.T, squared), few | certain


def _compared_with_all(
    queries: Float[Array, "b d"], certain: Bool[Array, " b"], other: Tree, k: int, index: Array, squared: Array
) -> tuple[Array, Array]:
    """The same, with those that are not certain compared with every point."""

    def one(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        certain, index, squared = state
        which = jnp.argmin(certain)
        away = jnp.sum((other.leaves - queries[which][None, :, None]) ** 2, axis=1).reshape(-1)
        nearest, place = lax.top_k(-away, k)
        return certain.at[which].set(True), index.at[:, which].set(place), squared.at[:, which].set(-nearest)

    _, index, squared = lax.while_loop(lambda state: ~jnp.all(state[0]), one, (certain, index, squared))
    return index, squared
