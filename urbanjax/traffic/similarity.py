"""How near two driven routes are (Eq. 33): samples against samples, or against the line through the other samples.

Where two routes coincide, distances to samples are a quarter of the other route's spacing on average and up to half of
it; distances to its line are 0. Nothing is kept per pair of samples: memory grows with the longer route only.
Batches go through vmap. A route without a sample is at distance 0 from everything and not `valid`.
"""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int

from urbanjax.geometry import polyline
from urbanjax.numerics import masked, safe
from urbanjax.numerics import tree as trees
from urbanjax.numerics.exact_nearest import nearest_among
from urbanjax.traffic.course.line import ring
from urbanjax.types import pytree

BLOCK = 256  # queries at once
PAIRS = 2**22  # up to which all are compared


@pytree
class Distances:
    """What the distances from the samples of one route to another route come to."""

    mean: Array  # [] m, Eq. 33
    rmse: Array  # [] m
    quantile: Array  # [] m, at the level asked for: the partial Hausdorff distance
    hausdorff: Array  # [] m, the greatest, one-sided


@pytree
class Similarity:
    """Two routes compared both ways."""

    there: Distances  # from X to Y
    back: Distances  # from Y to X
    mean: Array  # [] m, half of both means
    quantile: Array  # [] m, the greater one
    hausdorff: Array  # [] m, the greater one: a metric on closed sets
    valid: Array  # [] bool, both routes have a sample


def between_samples(
    x: Float[Array, "n d"],
    y: Float[Array, "m d"],
    *,
    x_mask: Bool[Array, " n"],
    y_mask: Bool[Array, " m"],
    level: float | Float[Array, ""] = 0.95,
    block: int = BLOCK,
) -> Similarity:
    """The samples of each route against the samples of the other, exactly, in one pass over the pairs.

        mean = (1 / n) sum_i min_j |x_i - y_j|

    Differentiable in both where the nearest sample is unique.
    Args: x [N, D], y [M, D] m; x_mask [N], y_mask [M], samples that count; level of the quantile, in [0, 1]; block,
    samples of x at once.
    """
    x, y = _held(x, x_mask), _held(y, y_mask)
    to_y, to_x = nearest(x, y, x_mask=x_mask, y_mask=y_mask, block=block)
    there, back = safe.norm(x - y[to_y]), safe.norm(y - x[to_x])
    return _similarity(there, back, x_mask, y_mask, level)


def between_lines(
    x: Float[Array, "n 2"],
    y: Float[Array, "m 2"],
    *,
    x_mask: Bool[Array, " n"],
    y_mask: Bool[Array, " m"],
    level: float | Float[Array, ""] = 0.95,
    closed: bool = False,
    block: int = BLOCK,
) -> Similarity:
    """The samples of each route against the line through the samples of the other, exactly.

    Differentiable in both where the nearest point of the line is unique. The line is broken where samples are missing.
    Args: x [N, 2], y [M, 2] m, in the order driven; x_mask [N], y_mask [M], samples that count; level of the quantile,
    in [0, 1]; closed, whether the lines end where they begin; block, samples at once.
    """
    x, y = _held(x, x_mask), _held(y, y_mask)
    there, back = (
        to_line(x, y, y_mask=y_mask, closed=closed, block=block),
        to_line(y, x, y_mask=x_mask, closed=closed, block=block),
    )
    return _similarity(there, back, x_mask, y_mask, level)


def to_line(
    x: Float[Array, "n 2"],
    y: Float[Array, "m 2"],
    *,
    y_mask: Bool[Array, " m"],
    closed: bool = False,
    block: int = BLOCK,
) -> Float[Array, " n"]:
    """Distance [m] of each point to the line through the samples of a route.

    Args: x [N, 2] m; y [M, 2] m, in the order driven; y_mask [M], samples that count; closed, whether the line ends
    where it begins; block, points at once.
    """
    y = _held(y, y_mask)
    line, mask = ring(y, y_mask) if closed else (y, y_mask)
    unused = jnp.zeros_like(line[:, 0])  # station, heading and curvature, which the distance does not need

    def distance(point: Array) -> Array:
        return polyline.project(line, point, mask=mask, station=unused, heading=unused, curvature=unused).distance

    return jax.lax.map(distance, x, batch_size=min(block, x.shape[0]))


def nearest(
    x: Float[Array, "n d"],
    y: Float[Array, "m d"],
    *,
    x_mask: Bool[Array, " n"],
    y_mask: Bool[Array, " m"],
    block: int = BLOCK,
) -> tuple[Int[Array, " n"], Int[Array, " m"]]:
    """For each sample the index of the nearest one in the other set; 0 if there is none.

    Of several whose squared distances are equal, or for large sets within 1e-5, any. Not differentiable.
    Args: x [N, D], y [M, D] m; x_mask [N], y_mask [M], samples that count; block, samples of x at once where all pairs
    are compared; memory is that many times M.
    """
    x, y = jax.lax.stop_gradient((x, y))
    if x.shape[0] * y.shape[0] <= PAIRS:
        return _of_all_pairs(x, y, x_mask, y_mask, block)
    depth = trees.depth(max(x.shape[0], y.shape[0]))
    one, two = trees.build(x.T, x_mask, levels=depth), trees.build(y.T, y_mask, levels=depth)
    to_y, to_x = nearest_among(one, two, k=1)[0][0], nearest_among(two, one, k=1)[0][0]
    return jnp.where(to_y < y.shape[0], to_y, 0), jnp.where(to_x < x.shape[0], to_x, 0)


def _of_all_pairs(
    x: Array, y: Array, x_mask: Array, y_mask: Array, block: int
) -> tuple[Int[Array, " n"], Int[Array, " m"]]:
    """The same by the distances of all pairs, which is faster for small sets."""
    n, m = x.shape[0], y.shape[0]
    block = min(block, n)
    count = -(-n // block)
    spare = count * block - n
    points = jnp.pad(x, ((0, spare), (0, 0))).reshape(count, block, -1)
    counts = jnp.pad(x_mask, (0, spare)).reshape(count, block)

    def search(carry: tuple[Array, Array], part: tuple[Array, Array, Array]) -> tuple[tuple[Array, Array], Array]:
        least, at = carry
        first, own, some = part
        pairs = ((own[:, None, i] - y[None, :, i]) ** 2 for i in range(y.shape[1]))
        squared = jnp.where(some[:, None] & y_mask[None], sum(pairs, jnp.zeros((block, m), x.dtype)), jnp.inf)
        here = jnp.min(squared, axis=0)
        nearer = here < least
        at = jnp.where(nearer, first + jnp.argmin(squared, axis=0).astype(jnp.int32), at)
        return (jnp.minimum(here, least), at), jnp.argmin(squared, axis=1).astype(jnp.int32)

    start = (jnp.full(m, jnp.inf, x.dtype), jnp.zeros(m, jnp.int32))
    firsts = block * jnp.arange(count, dtype=jnp.int32)
    (_, to_x), to_y = jax.lax.scan(search, start, (firsts, points, counts))
    return to_y.reshape(-1)[:n], to_x


def _held(points: Array, mask: Array) -> Array:
    """The points, with 0 for what does not count and may be anything."""
    return jnp.where(mask[:, None], points, 0)


def _similarity(there: Array, back: Array, x_mask: Array, y_mask: Array, level: float | Array) -> Similarity:
    valid = jnp.any(x_mask) & jnp.any(y_mask)
    one, two = summarised(there, x_mask & valid, level=level), summarised(back, y_mask & valid, level=level)
    return Similarity(
        there=one,
        back=two,
        mean=0.5 * (one.mean + two.mean),
        quantile=jnp.maximum(one.quantile, two.quantile),
        hausdorff=jnp.maximum(one.hausdorff, two.hausdorff),
        valid=valid,
    )


def summarised(
    distance: Float[Array, "*b n"], mask: Bool[Array, "*b n"], *, level: float | Float[Array, ""] = 0.95
) -> Distances:
    """Eq. 33 and its relatives [*b] from the distance [m] of each sample to the other route, however it was found.

    Args: distance [..., N] m; mask [..., N], samples that count; level of the quantile, in [0, 1].
    """
    return Distances(
        mean=masked.mean(distance, mask),
        rmse=masked.rms(distance, mask),
        quantile=masked.quantile(distance, mask, level=level),
        hausdorff=masked.largest(distance, mask),
    )
