"""Where samples are along a reference line, and how far beside it: station and lateral offset."""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.geometry import polyline
from urbanjax.numerics import masked, safe
from urbanjax.types import pytree

BLOCK = 256  # queries at once


@pytree
class Place:
    """Samples in the frame of a reference line."""

    station: Array  # [N] m; on a closed line in [0, length)
    offset: Array  # [N] m, left positive
    distance: Array  # [N] m, to the line
    length: Array  # [] m, of the line


@pytree
class Profile:
    """Lateral offset by station, in B bins of equal length."""

    station: Array  # [B] m, middle of the bin
    mean: Array  # [B] m
    std: Array  # [B] m
    count: Array  # [B] int32


def ring(points: Float[Array, "p 2"], mask: Bool[Array, " p"]) -> tuple[Float[Array, "q 2"], Bool[Array, " q"]]:
    """A closed line, as a polyline [P + 2] that goes on from its last point that counts to its first.

    Args: points [P, 2] m; mask [P], points that count.
    """
    last = points.shape[0] - 1 - jnp.argmax(mask[::-1])
    some = jnp.any(mask)
    return (
        jnp.concatenate([points, points[last][None], points[jnp.argmax(mask)][None]]),
        jnp.concatenate([mask, jnp.stack([some, some])]),
    )


def place(
    points: Float[Array, "n 2"],
    mask: Bool[Array, " n"],
    *,
    line: Float[Array, "p 2"],
    line_mask: Bool[Array, " p"],
    closed: bool = False,
    block: int = BLOCK,
) -> Place:
    """Station and signed lateral offset [m] of each sample, by the nearest point of the line.

    Differentiable where that point is unique and no vertex of the line; where a line passes itself, the nearer pass
    counts. Samples that do not count are at 0. The line is padded after its points and does not repeat its first.
    Args: points [N, 2] m; mask [N], samples that count; line [P, 2] m, and line_mask [P], its points that count;
    closed, whether the line goes on from its last point to its first; block, samples looked up at once.
    """
    line = jnp.where(line_mask[:, None], line, 0)
    whole, counts = ring(line, line_mask) if closed else (line, line_mask)
    station = polyline.arc_length(whole, counts)
    heading, curvature = polyline.headings(whole, counts), jnp.zeros_like(station)

    def found(point: Array) -> tuple[Array, Array, Array]:
        at = polyline.project(whole, point, mask=counts, station=station, heading=heading, curvature=curvature)
        # Nothing follows the end of a closed line, so beside the seam the offset is that from the vertex.
        side = jnp.where(at.offset < 0, -at.distance, at.distance)
        return at.station, side if closed else at.offset, at.distance

    points = jnp.where(mask[:, None], points, 0)
    stations, offset, distance = jax.lax.map(found, points, batch_size=min(block, points.shape[0]))
    length = station[-1]
    if closed:
        stations = jnp.where(stations >= length, stations - length, stations)
    stations, offset, distance = (jnp.where(mask, x, 0) for x in (stations, offset, distance))
    return Place(stations, offset, distance, length)


def profile(
    station: Float[Array, " n"],
    offset: Float[Array, " n"],
    *,
    mask: Bool[Array, " n"],
    length: float | Float[Array, ""],
    bins: int,
) -> Profile:
    """Mean and standard deviation of the lateral offset by station, in equal bins of [0, length).

    Differentiable in the offset. Bins without a sample have count 0 and offset 0.
    Args: station, offset [N] m; mask [N], samples that count; length [m] of the line; bins, their number.
    """
    width = length / bins
    index = jnp.clip(jnp.floor(jnp.where(mask, station, 0) / width), 0, bins - 1).astype(jnp.int32)
    index = jnp.where(mask, index, bins)

    def summed(x: Array) -> Array:
        return jax.ops.segment_sum(jnp.where(mask, x, 0), index, bins + 1)[:bins]

    count = summed(jnp.ones_like(offset))
    mean = safe.divide(summed(offset), count)
    deviation = offset - jnp.concatenate([mean, jnp.zeros_like(mean[:1])])[index]
    spread = safe.sqrt(safe.divide(summed(deviation**2), count))
    middle = width * (jnp.arange(bins, dtype=offset.dtype) + 0.5)
    return Profile(middle, mean, spread, count.astype(jnp.int32))


def apart(one: Profile, two: Profile) -> tuple[Float[Array, ""], Float[Array, ""], Bool[Array, ""]]:
    """Mean absolute and root mean square difference [m] of two profiles over the bins both have, and whether any is.

    Args: one, two, profiles with the same bins.
    """
    both = (one.count > 0) & (two.count > 0)
    difference = one.mean - two.mean
    return masked.mean(jnp.abs(difference), both), masked.rms(difference, both), jnp.any(both)
