"""A tree of points without pointers: sorted along a space-filling curve, and cut into groups of four, again and again.

It adapts to the density of the points, and is made of dense arithmetic on arrays of static shape.
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int, Shaped

from urbanjax.numerics import hilbert
from urbanjax.types import pytree

FAN = 4  # parts of a group
TOP = 256  # groups up to which all look at all


@pytree
class Tree:
    """N points along the curve, in groups of FAN, and the boxes around groups by the groups above them."""

    order: Array  # [N] int32, the points along the curve, invalid ones last
    leaves: Array  # [G, d, FAN], the points by groups; inf where there is none
    levels: tuple[Array, ...]  # [G / FAN, 2 d, FAN] and so on upwards: (low, -high) of boxes, so that inf is none
    count: Array  # int32, valid points


def depth(points: int) -> int:
    """Levels of boxes above the leaves, so that the highest holds at most TOP boxes. Args: points, their number."""
    levels, size = 1, FAN
    while points > TOP * size:
        levels, size = levels + 1, size * FAN
    return levels


def build(points: Float[Array, "d n"], valid: Bool[Array, " n"], *, levels: int, passes: int = 2) -> Tree:
    """The tree of the valid points.

    Args: points [d, N]; valid [N], points that count; levels of boxes, at least 1; passes of sorting (see
    `hilbert.order`).
    """
    d, n = points.shape
    order = hilbert.order(points, valid, passes=passes)
    size = FAN**levels
    groups = -(-n // (size * FAN)) * size
    flat = jnp.pad(jnp.where(valid[None], points, jnp.inf), ((0, 0), (0, 1)), constant_values=jnp.inf).reshape(-1)
    places = jnp.pad(order, (0, groups * FAN - n), constant_values=n).reshape(groups, 1, FAN)
    leaves = at(flat, places + (jnp.arange(d, dtype=jnp.int32) * (n + 1))[None, :, None])
    # Boxes are kept as (low, -high), so that the box around boxes is their minimum, and a missing one is inf.
    boxes = [_above(jnp.concatenate([leaves, jnp.where(jnp.isfinite(leaves), -leaves, jnp.inf)], axis=1))]
    while len(boxes) < levels:
        boxes.append(_above(boxes[-1]))
    return Tree(order, leaves, tuple(boxes), jnp.sum(valid, dtype=jnp.int32))


def at(table: Shaped[Array, "n *s"], index: Int[Array, "*m"]) -> Array:
    """Rows of a table, without the checks for places outside it. Args: table [n, *s]; index [*m]."""
    return table.at[index].get(mode="clip", wrap_negative_indices=False)


def _above(parts: Float[Array, "g b f"]) -> Float[Array, "p b f"]:
    """The boxes around the parts of each group, as parts of the groups above."""
    g, b, f = parts.shape
    return jnp.min(jnp.swapaxes(parts.reshape(g // FAN, FAN, b, f), 1, 2), axis=-1)
