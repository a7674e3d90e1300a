"""Laps of a course from stations over time: which lap each sample is in, and how long each took."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.traffic.crossing import crossings, progress
from urbanjax.types import field, pytree, static


@pytree
class LapParams:
    """What counts as passing the line that begins a lap."""

    # m beyond the line at which it has been passed: more than the jitter of the stations
    margin: float = field(default=2.0, metadata={"range": (0.0, 1e3)})
    # m from the line at which a series may begin or end and its lap still be complete: its time is that between the
    # first and the last sample, for nothing is extrapolated
    tolerance: float = field(default=0.0, metadata={"range": (0.0, 1e3)})
    capacity: int = static(default=32, metadata={"range": (1, 10_000)})  # laps that are kept


@pytree
class Laps:
    """Laps 0 to K - 1 of one vehicle; lap 0 is what it drives before it first passes the line."""

    way: Array  # [T] m, made since the line of lap 0
    lap: Array  # [T] int32, of each sample
    start: Array  # [K] s, 0 where not seen
    end: Array  # [K] s, 0 where not seen
    time: Array  # [K] s, 0 where not complete
    complete: Array  # [K] bool, both its ends were seen
    count: Array  # [] int32, lines reached; where more than the capacity, the last lap kept goes on


def laps(
    station: Float[Array, " t"],
    time: Float[Array, " t"],
    *,
    mask: Bool[Array, " t"],
    length: float | Float[Array, ""],
    params: LapParams,
    closed: bool = True,
) -> Laps:
    """Laps of a series of stations; on an open line, the one way from its start to its end.

    Crossing times are interpolated and differentiable in stations and times. Standing on the line, jitter across it and
    backing over it begin no lap.
    Args: station [T] m, in any multiple of the length; time [T] s; mask [T], samples that count; length [m] of the
    line; closed, whether the line ends where it begins.
    """
    way = progress(station, mask, length=length, closed=closed)
    count = params.capacity + 1 if closed else 2
    lines = length * jnp.arange(count, dtype=way.dtype)
    passed = crossings(way, time, mask=mask, stations=lines, margin=params.margin, tolerance=params.tolerance)
    start, end = passed.time[:-1], passed.time[1:]
    complete = passed.valid[:-1] & passed.valid[1:]
    index = jnp.arange(way.shape[0], dtype=jnp.int32)
    after = (index[:, None] >= passed.sample[None, 1:]) & passed.valid[None, 1:]
    total = jnp.floor(jnp.max(way) / length) if closed else jnp.sum(passed.valid[1:])
    return Laps(
        way=way,
        lap=jnp.sum(after, axis=1, dtype=jnp.int32),
        start=start,
        end=end,
        time=jnp.where(complete, end - start, 0),
        complete=complete,
        count=jnp.maximum(total, 0).astype(jnp.int32),
    )
