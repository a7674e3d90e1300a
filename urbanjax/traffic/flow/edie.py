"""Flow, density and speed in regions of space and time (Edie), exact for trajectories that are linear between samples.

Batches go through vmap.
"""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.numerics import safe
from urbanjax.types import pytree


@pytree
class Flow:
    """Traffic in each region."""

    flow: Array  # [...] vehicles/s
    density: Array  # [...] vehicles/m
    speed: Array  # [...] m/s, flow / density; 0 where no vehicle was
    distance: Array  # [...] m driven inside
    time: Array  # [...] s spent inside
    occupied: Array  # [...] bool, a vehicle was inside


def region(
    way: Float[Array, "v t"],
    time: Float[Array, " t"],
    *,
    mask: Bool[Array, "v t"],
    period: Float[Array, "2"],
    reach: Float[Array, "2"],
    length: float | Float[Array, ""] | None = None,
) -> Flow:
    """Flow, density and speed (each []) in one rectangle of time and station.

        q = sum d_i / |A|,    k = sum t_i / |A|,    v = q / k    (Edie 1963)

    with d_i and t_i what vehicle i drove and spent inside, |A| metres times seconds. Between two samples that count a
    vehicle moves evenly; each piece is cut at the sides of the rectangle. A vehicle that stands on a side is inside at
    the lower one only. Driving back counts against the distance. Differentiable where no sample lies on a side.
    Args: way [V, T] m; time [T] s; mask [V, T], samples that count; period [2] s, reach [2] m: from and to; length [m]
    of a closed course, on which the way may hold any number of laps (the region then lies within 0 and the length; no
    piece is longer than a lap).
    """
    t0, t1 = time[None, :-1], time[None, 1:]
    x0, x1 = way[:, :-1], way[:, 1:]
    counts = mask[:, :-1] & mask[:, 1:]
    x0, x1 = jnp.where(counts, x0, 0), jnp.where(counts, x1, 0)
    if length is not None:
        lap = length * jnp.floor(x0 / length)
        x0, x1 = x0 - lap, x1 - lap
    share = jnp.zeros_like(x0)
    in_time = _within(t0, t1, period)
    for shift in (0,) if length is None else (-1, 0, 1):
        moved = 0 if length is None else shift * length
        low, high = _overlap(in_time, _within(x0, x1, reach + moved))
        share = share + jnp.maximum(high - low, 0)
    share = jnp.where(counts, share, 0)
    spent, driven = jnp.sum(share * (t1 - t0)), jnp.sum(share * (x1 - x0))
    area = (period[1] - period[0]) * (reach[1] - reach[0])
    return Flow(
        flow=safe.divide(driven, area),
        density=safe.divide(spent, area),
        speed=safe.divide(driven, spent),
        distance=driven,
        time=spent,
        occupied=spent > 0,
    )


def diagram(
    way: Float[Array, "v t"],
    time: Float[Array, " t"],
    *,
    mask: Bool[Array, "v t"],
    times: Float[Array, " a"],
    stations: Float[Array, " b"],
    length: float | Float[Array, ""] | None = None,
) -> Flow:
    """Fundamental diagram: `region` for each cell [A - 1, B - 1] between given times [s] and stations [m].

    Args: way [V, T] m; time [T] s; mask [V, T], samples that count; times [A] s and stations [B] m, sides of the cells;
    length [m] of a closed course, as of `region`.
    """
    periods = jnp.stack([times[:-1], times[1:]], axis=-1)
    reaches = jnp.stack([stations[:-1], stations[1:]], axis=-1)
    a, b = periods.shape[0], reaches.shape[0]
    cells = (jnp.repeat(periods, b, axis=0), jnp.tile(reaches, (a, 1)))
    found = jax.lax.map(lambda cell: region(way, time, mask=mask, period=cell[0], reach=cell[1], length=length), cells)
    return jax.tree.map(lambda x: x.reshape(a, b), found)


def _within(start: Array, end: Array, side: Array) -> tuple[Array, Array]:
    """Shares of each piece at which it enters and leaves the interval; a piece that rests is in [from, to) or not."""
    step = end - start
    rests = step == 0
    one = safe.divide(side[0] - start, step)
    two = safe.divide(side[1] - start, step)
    low, high = jnp.minimum(one, two), jnp.maximum(one, two)
    inside = (start >= side[0]) & (start < side[1])
    low = jnp.where(rests, jnp.where(inside, 0, 1), low)
    high = jnp.where(rests, jnp.where(inside, 1, 0), high)
    return jnp.clip(low, 0, 1), jnp.clip(high, 0, 1)


def _overlap(one: tuple[Array, Array], two: tuple[Array, Array]) -> tuple[Array, Array]:
    return jnp.maximum(one[0], two[0]), jnp.minimum(one[1], two[1])
