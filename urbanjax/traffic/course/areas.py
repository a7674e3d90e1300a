"""Named areas of a course: intervals of stations, which samples are in them, and how long a passage takes."""

import math
from collections.abc import Iterable

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int

from urbanjax.traffic.course.laps import LapParams, Laps
from urbanjax.traffic.crossing import crossings
from urbanjax.types import pytree, static
from urbanjax.types.errors import TrafficError


@pytree
class Areas:
    """A areas, from start up to end; one whose end is not beyond its start passes over the start of the course."""

    start: Array  # [A] m
    end: Array  # [A] m
    names: tuple[str, ...] = static()  # A


def areas(named: Iterable[tuple[str, float, float]], length: float) -> Areas:
    """Areas from (name, start, end) with stations [m] from 0 to the length of the course.

    Args: named, the rows (name, start, end); length [m]. Raises TrafficError for a name that is empty or given twice,
    or a station that is not on the course.
    """
    rows = list(named)
    for name, start, end in rows:
        if not name or sum(name == other for other, _, _ in rows) > 1:
            raise TrafficError(f"area '{name}': give every area a name of its own")
        for key, value in (("start", start), ("end", end)):
            if not (math.isfinite(value) and 0 <= value <= length):
                raise TrafficError(f"area '{name}': {key} is {value} m; give a station from 0 to {length} m")
        if start == end:
            raise TrafficError(f"area '{name}' is empty: its start and end are {start} m; give two stations")
    return Areas(
        jnp.array([start for _, start, _ in rows], float),
        jnp.array([end for _, _, end in rows], float),
        tuple(name for name, _, _ in rows),
    )


def inside(areas: Areas, station: Float[Array, " t"]) -> Bool[Array, "a t"]:
    """Which samples, by their station on the course [m], are in each area.

    Args: areas, the A areas of a course; station [T] m.
    """
    start, end, s = areas.start[:, None], areas.end[:, None], station[None]
    return jnp.where(start < end, (s >= start) & (s < end), (s >= start) | (s < end))


def index(areas: Areas, station: Float[Array, " t"]) -> tuple[Int[Array, " t"], Bool[Array, " t"]]:
    """Index of the first area that each sample is in, and whether it is in any (if not, the index is 0).

    Args: areas, the A areas of a course; station [T] m.
    """
    held = inside(areas, station)
    return jnp.argmax(held, axis=0).astype(jnp.int32), jnp.any(held, axis=0)


def selection(
    areas: Areas, laps: Laps, *, mask: Bool[Array, " t"], length: float | Float[Array, ""]
) -> Bool[Array, "k a t"]:
    """Samples of each lap in each area. Samples in an area over the start belong to the lap that they are in.

    Args: areas, the A areas of a course; laps, the K laps of the samples; mask [T], samples that count; length [m] of
    the course.
    """
    held = inside(areas, laps.way - length * jnp.floor(laps.way / length)) & mask[None]
    lap = jnp.arange(laps.time.shape[0], dtype=jnp.int32)[:, None] == laps.lap[None]
    return held[None] & lap[:, None]


def passages(
    areas: Areas,
    laps: Laps,
    *,
    time: Float[Array, " t"],
    mask: Bool[Array, " t"],
    length: float | Float[Array, ""],
    params: LapParams,
) -> tuple[Float[Array, "k a"], Bool[Array, "k a"]]:
    """Seconds from entering to leaving each area in each lap that it is entered in, and whether both were seen.

    Interpolated between samples and differentiable, as lap times are.
    Args: areas, the A areas of a course; laps, the K laps of the samples; time [T] s; mask [T], samples that count;
    length [m] of the course.
    """
    begin = length * jnp.arange(laps.time.shape[0], dtype=laps.way.dtype)[:, None]
    end = jnp.where(areas.end > areas.start, areas.end, areas.end + length)
    ends = jnp.stack([begin + areas.start[None], begin + end[None]])
    passed = crossings(
        laps.way, time, mask=mask, stations=ends.reshape(-1), margin=params.margin, tolerance=params.tolerance
    )
    times, seen = passed.time.reshape(ends.shape), passed.valid.reshape(ends.shape)
    both = seen[0] & seen[1]
    return jnp.where(both, times[1] - times[0], 0), both
