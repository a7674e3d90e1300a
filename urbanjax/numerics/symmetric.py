"""Symmetric 3x3 matrices as six entries (xx, xy, xz, yy, yz, zz), batch last: plain arithmetic that fuses.

Batches of small matrices through `linalg` are slow on every device; written out they cost a few operations per entry.
"""

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float
from numpy.polynomial import chebyshev

from urbanjax.numerics import safe

ENTRIES = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
PLACE = ((0, 1, 2), (1, 3, 4), (2, 4, 5))  # of entry (i, j) among the six

IDENTITY = (1, 0, 0, 1, 0, 1)


def pack(matrix: Float[Array, "*n 3 3"]) -> Float[Array, "6 *n"]:
    """The six entries of symmetric matrices. Args: matrix [*n, 3, 3]."""
    return jnp.stack([matrix[..., i, j] for i, j in ENTRIES])


def unpack(s: Float[Array, "6 *n"]) -> Float[Array, "*n 3 3"]:
    """The full matrices. Args: s [6, *n]."""
    return jnp.stack([jnp.stack([s[PLACE[i][j]] for j in range(3)], axis=-1) for i in range(3)], axis=-2)


def outer(v: Float[Array, "3 *n"]) -> Float[Array, "6 *n"]:
    """The outer product v v'. Args: v [3, *n]."""
    return jnp.stack([v[i] * v[j] for i, j in ENTRIES])


def product(s: Float[Array, "6 *n"], v: Float[Array, "3 *n"]) -> Float[Array, "3 *n"]:
    """S v. Args: s [6, *n]; v [3, *n]."""
    return jnp.stack([sum((s[PLACE[i][j]] * v[j] for j in range(1, 3)), s[PLACE[i][0]] * v[0]) for i in range(3)])


def inner(a: Float[Array, "3 *n"], b: Float[Array, "3 *n"]) -> Float[Array, "*n"]:
    """a'b, written out. Args: a, b [3, *n]."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def determinant(s: Float[Array, "6 *n"]) -> Float[Array, "*n"]:
    """The determinants. Args: s [6, *n]."""
    xx, xy, xz, yy, yz, zz = s
    return xx * (yy * zz - yz * yz) + xy * (xz * yz - xy * zz) + xz * (xy * yz - xz * yy)


def inverse(s: Float[Array, "6 *n"]) -> Float[Array, "6 *n"]:
    """The inverses by the adjugate; 0 where the determinant is 0. Args: s [6, *n]."""
    return adjugate(s) * safe.divide(jnp.ones_like(s[0]), determinant(s))[None]


def adjugate(s: Float[Array, "6 *n"]) -> Float[Array, "6 *n"]:
    """The adjugates: the inverses times the determinants. Args: s [6, *n]."""
    xx, xy, xz, yy, yz, zz = s
    return jnp.stack(
        [
            yy * zz - yz * yz,
            xz * yz - xy * zz,
            xy * yz - xz * yy,
            xx * zz - xz * xz,
            xy * xz - xx * yz,
            xx * yy - xy * xy,
        ]
    )


def congruence(r: Float[Array, "3 3"], s: Float[Array, "6 *n"]) -> Float[Array, "6 *n"]:
    """R S R' for one R. Args: r [3, 3]; s [6, *n]."""
    half = [[sum((r[i, k] * s[PLACE[k][j]] for k in range(1, 3)), r[i, 0] * s[j]) for j in range(3)] for i in range(3)]
    return jnp.stack([sum((half[i][k] * r[j, k] for k in range(1, 3)), half[i][0] * r[j, 0]) for i, j in ENTRIES])


def eigenvalues(s: Float[Array, "6 *n"]) -> Float[Array, "3 *n"]:
    """The eigenvalues in ascending order, by Cardano's formula. Not differentiable where two are equal.

    Args: s [6, *n].
    """
    mean, size, bend = _invariants(s)
    low, high = _third(-bend)[None], _third(bend)[None]
    return mean[None] + 2 * size[None] * (_column((-1, 1, 0), mean) * low + _column((0, -1, 1), mean) * high)


def smallest_eigenvector(s: Float[Array, "6 *n"]) -> Float[Array, "3 *n"]:
    """The unit eigenvector of the smallest eigenvalue, of either sign; the z axis where all directions are alike.

    Args: s [6, *n].
    """
    mean, size, bend = _invariants(s)
    low = mean - 2 * size * _third(-bend)
    xx, xy, xz, yy, yz, zz = s - _column(IDENTITY, low) * low[None]
    x, y, z = (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)
    # All parallel to it: the columns of the adjugate. The longest one is the most exact.
    a, b, c = _cross(y, z), _cross(z, x), _cross(x, y)
    aa, bb, cc = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2] for v in (a, b, c))
    best = jnp.maximum(aa, jnp.maximum(bb, cc))
    vector = [jnp.where(aa == best, i, jnp.where(bb == best, j, k)) for i, j, k in zip(a, b, c, strict=True)]
    known = best > 0
    inverse_size = 1 / safe.sqrt(jnp.where(known, best, 1))
    return jnp.stack([jnp.where(known, v * inverse_size, up) for v, up in zip(vector, (0, 0, 1), strict=True)])


def _invariants(s: Array) -> tuple[Array, Array, Array]:
    """What the eigenvalues are made of: their mean, spread p, and det((S - mean) / p) / 2 in [-1, 1]."""
    xx, xy, xz, yy, yz, zz = s
    mean = (xx + yy + zz) / 3
    a, b, c = xx - mean, yy - mean, zz - mean
    size = safe.sqrt((a * a + b * b + c * c + 2 * (xy * xy + xz * xz + yz * yz)) / 6)
    scaled = jnp.stack([a, xy, xz, b, yz, c]) * safe.divide(jnp.ones_like(size), size)[None]
    return mean, size, jnp.clip(determinant(scaled) / 2, -1, 1)


# cos(2/3 arccos t)^2 for t in [0, 1], as Chebyshev polynomials of 2 t - 1, to 3e-15.
NODES = chebyshev.chebpts1(20)
THIRD = chebyshev.chebfit(NODES, np.cos(2 / 3 * np.arccos((NODES + 1) / 2)) ** 2, 19)


def _third(cosine: Array) -> Array:
    """cos(arccos(c) / 3), by a polynomial of cos(arccos(c) / 2): the inverse cosine is slow, and singular at 1."""
    x = 2 * safe.sqrt((1 + cosine) / 2) - 1
    now, before = jnp.zeros_like(x), jnp.zeros_like(x)
    for term in THIRD[:0:-1]:
        now, before = 2 * x * now - before + term, now
    # The square is what is interpolated, since XLA computes a root once, and a sum anew for each use.
    return jnp.sqrt(x * now - before + THIRD[0])


def _column(entries: tuple[int, ...], like: Array) -> Array:
    """Numbers along a first axis, to multiply a batch with. What XLA repeats along an axis, it computes once."""
    return jnp.array(entries, like.dtype).reshape(len(entries), *(1,) * like.ndim)


def _cross(a: tuple[Array, ...], b: tuple[Array, ...]) -> tuple[Array, ...]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
