"""When a series passes given values: the times of crossing a station, robust to jitter and to missing samples."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.numerics import masked, safe
from urbanjax.types import pytree


@pytree
class Crossings:
    """Passages of K stations, upwards, each once."""

    time: Array  # [K] s, interpolated; 0 where there is none
    sample: Array  # [K] int32, first sample at or beyond the station; T where there is none
    valid: Array  # [K] bool


def progress(
    station: Float[Array, " t"], mask: Bool[Array, " t"], *, length: float | Float[Array, ""], closed: bool = True
) -> Float[Array, " t"]:
    """Way made along a line [m]: the station, unwrapped on a closed line, so that lap k begins at k times its length.

    Steps between samples that count are taken the short way round, so none may be longer than half a lap. A sample that
    does not count stands where the last one before it did. Starts at the first station in [0, length).
    Args: station [T] m; mask [T], samples that count; length [m] of the line; closed, whether it ends where it begins.
    """
    held = jnp.where(jnp.any(mask), jnp.where(mask, station, 0)[masked.latest(mask)], 0)
    if not closed:
        return held
    step = jnp.diff(held)
    step = step - length * jnp.round(step / length)
    start = held[:1] - length * jnp.floor(held[:1] / length)
    return jnp.concatenate([start, start + jnp.cumsum(step)])


def crossings(
    way: Float[Array, " t"],
    time: Float[Array, " t"],
    *,
    mask: Bool[Array, " t"],
    stations: Float[Array, " k"],
    margin: float | Float[Array, ""] = 2.0,
    tolerance: float | Float[Array, ""] = 0.0,
) -> Crossings:
    """When the way made passed each station: the last time upwards before it was beyond by the margin.

    Jitter around a station, standing on it and backing over it count once. At the end of the series it is enough to be
    at the station to within the tolerance, and a series that starts within the tolerance beyond it has passed it
    with its first sample. Differentiable in the way and the time (at the sample chosen).
    Args: way [T] m; time [T] s, not decreasing; mask [T], samples that count; stations [K] m; margin, tolerance [m].
    """
    held = masked.latest(mask)
    some, n = jnp.any(mask), way.shape[0]
    way, time = jnp.where(some, jnp.where(mask, way, 0)[held], 0), jnp.where(mask, time, 0)[held]
    index = jnp.arange(n, dtype=jnp.int32)

    beyond = way[None] >= stations[:, None] + margin
    confirmed = jnp.where(jnp.any(beyond, axis=1), jnp.argmax(beyond, axis=1), n)
    up = (way[:-1][None] < stations[:, None]) & (way[1:][None] >= stations[:, None])
    up = jnp.pad(up, ((0, 0), (1, 0))) & (index[None] <= confirmed[:, None])
    sample = jnp.max(jnp.where(up, index[None], -1), axis=1)
    # Stations that the series starts or ends at.
    first, last = jnp.argmax(mask).astype(jnp.int32), held[-1]
    started = (sample < 0) & (way[0] >= stations) & (way[0] <= stations + tolerance)
    ended = (sample < 0) & (way[0] < stations) & (way[-1] >= stations - tolerance)
    crossed = (sample >= 0) & ((confirmed < n) | (way[-1] >= stations - tolerance))
    valid = some & (crossed | started | ended)

    to = jnp.maximum(sample, 1)
    share = jnp.clip(safe.divide(stations - way[to - 1], way[to] - way[to - 1]), 0, 1)
    passed = time[to - 1] + share * (time[to] - time[to - 1])
    passed = jnp.where(started, time[0], jnp.where(ended, time[-1], passed))
    sample = jnp.where(started, first, jnp.where(ended, last, sample))
    return Crossings(jnp.where(valid, passed, 0), jnp.where(valid, sample, n), valid)
