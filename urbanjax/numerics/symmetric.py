"""Symmetric 3x3 matrices as six entries (xx, xy, xz, yy, yz, zz), batch last: plain arithmetic that fuses.

Batches of small matrices through `linalg` are slow on every device; written out they cost a few operations per entry.
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import safe

ENTRIES = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
PLACE = ((0, 1, 2), (1, 3, 4), (2, 4, 5))  # of entry (i, j) among the six

IDENTITY = (1, 0, 0, 1, 0, 1)


def pack(matrix: Float[Array, "*n 3 3"]) -> Float[Array, "6 *n"]:
    """The six entries of symmetric matrices."""
    return jnp.stack([matrix[..., i, j] for i, j in ENTRIES])


def unpack(s: Float[Array, "6 *n"]) -> Float[Array, "*n 3 3"]:
    """The full matrices."""
    return jnp.stack([jnp.stack([s[PLACE[i][j]] for j in range(3)], axis=-1) for i in range(3)], axis=-2)


def outer(v: Float[Array, "3 *n"]) -> Float[Array, "6 *n"]:
    """The outer product v v'."""
    return jnp.stack([v[i] * v[j] for i, j in ENTRIES])


def product(s: Float[Array, "6 *n"], v: Float[Array, "3 *n"]) -> Float[Array, "3 *n"]:
    """S v."""
    return jnp.stack([sum((s[PLACE[i][j]] * v[j] for j in range(1, 3)), s[PLACE[i][0]] * v[0]) for i in range(3)])


def inner(a: Float[Array, "3 *n"], b: Float[Array, "3 *n"]) -> Float[Array, "*n"]:
    """a'b, written out."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def determinant(s: Float[Array, "6 *n"]) -> Float[Array, "*n"]:
    """The determinants."""
    xx, xy, xz, yy, yz, zz = s
    return xx * (yy * zz - yz * yz) + xy * (xz * yz - xy * zz) + xz * (xy * yz - xz * yy)


def inverse(s: Float[Array, "6 *n"]) -> Float[Array, "6 *n"]:
    """The inverses by the adjugate; 0 where the determinant is 0."""
    xx, xy, xz, yy, yz, zz = s
    adjugate = jnp.stack(
        [
            yy * zz - yz * yz,
            xz * yz - xy * zz,
            xy * yz - xz * yy,
            xx * zz - xz * xz,
            xy * xz - xx * yz,
            xx * yy - xy * xy,
        ]
    )
    return adjugate * safe.divide(jnp.ones_like(xx), determinant(s))[None]


def congruence(r: Float[Array, "3 3"], s: Float[Array, "6 *n"]) -> Float[Array, "6 *n"]:
    """R S R' for one R."""
    half = [[sum((r[i, k] * s[PLACE[k][j]] for k in range(1, 3)), r[i, 0] * s[j]) for j in range(3)] for i in range(3)]
    return jnp.stack([sum((half[i][k] * r[j, k] for k in range(1, 3)), half[i][0] * r[j, 0]) for i, j in ENTRIES])


def eigenvalues(s: Float[Array, "6 *n"]) -> Float[Array, "3 *n"]:
    """The eigenvalues in ascending order, by Cardano's formula. Not differentiable where two are equal."""
    xx, xy, xz, yy, yz, zz = s
    mean = (xx + yy + zz) / 3
    a, b, c = xx - mean, yy - mean, zz - mean
    size = safe.sqrt((a * a + b * b + c * c + 2 * (xy * xy + xz * xz + yz * yz)) / 6)
    scaled = jnp.stack([a, xy, xz, b, yz, c]) * safe.divide(jnp.ones_like(size), size)[None]
    angle = jnp.arccos(jnp.clip(determinant(scaled) / 2, -1, 1)) / 3
    high = mean + 2 * size * jnp.cos(angle)
    low = mean + 2 * size * jnp.cos(angle + 2 * jnp.pi / 3)
    return jnp.stack([low, 3 * mean - low - high, high])


def smallest_eigenvector(s: Float[Array, "6 *n"]) -> Float[Array, "3 *n"]:
    """The unit eigenvector of the smallest eigenvalue, of either sign; the z axis where all directions are alike."""
    low = eigenvalues(s)[0]
    xx, xy, xz, yy, yz, zz = s[0] - low, s[1], s[2], s[3] - low, s[4], s[5] - low
    rows = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
    crosses = jnp.stack([_cross(rows[i], rows[j]) for i, j in ((0, 1), (0, 2), (1, 2))])
    sizes = jnp.sum(crosses * crosses, axis=1)
    best = jnp.argmax(sizes, axis=0)
    vector = jnp.where(best == 0, crosses[0], jnp.where(best == 1, crosses[1], crosses[2]))
    size = safe.sqrt(jnp.sum(vector * vector, axis=0))
    up = jnp.stack([jnp.zeros_like(low), jnp.zeros_like(low), jnp.ones_like(low)])
    known = jnp.expand_dims(size > 0, 0)
    return jnp.where(known, vector / jnp.where(known, size[None], 1), up)


def _cross(a: tuple[Array, ...], b: tuple[Array, ...]) -> Array:
    return jnp.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
