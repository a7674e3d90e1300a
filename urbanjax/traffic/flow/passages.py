"""What a detector at a station would see: passages, headways and throughput. Travel times between two stations."""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.numerics import masked, safe
from urbanjax.traffic.crossing import crossings
from urbanjax.types import pytree


@pytree
class Passages:
    """Passages of one station by all vehicles, in the order of time; V * laps entries, those that count first."""

    time: Array  # [N] s, 0 where not valid
    vehicle: Array  # [N] int32, row of the vehicle
    headway: Array  # [N] s since the passage before, 0 where there is none
    valid: Array  # [N] bool
    count: Array  # [] int32


def passages(
    way: Float[Array, "v t"],
    time: Float[Array, " t"],
    *,
    mask: Bool[Array, "v t"],
    station: float | Float[Array, ""],
    margin: float | Float[Array, ""] = 2.0,
    length: float | Float[Array, ""] = 0.0,
    laps: int = 1,
) -> Passages:
    """Passages of a station, interpolated in time, each vehicle once (a lap).

    Differentiable in the ways.
    Args: way [V, T] m, unwrapped on a closed course; time [T] s; mask [V, T], samples that count; station [m]; margin
    [m] beyond it at which it has been passed; length [m] of a closed course, whose laps 0 to `laps` - 1 are looked at.
    """
    stations = station + length * jnp.arange(laps, dtype=way.dtype)
    found = jax.vmap(lambda w, m: crossings(w, time, mask=m, stations=stations, margin=margin))(way, mask)
    valid, times = found.valid.reshape(-1), found.time.reshape(-1)
    order = jnp.argsort(jnp.where(valid, times, jnp.inf), stable=True)
    valid, times = valid[order], times[order]
    follows = jnp.concatenate([jnp.zeros_like(valid[:1]), valid[1:]])
    return Passages(
        time=times,
        vehicle=(order // laps).astype(jnp.int32),
        headway=jnp.where(follows, times - jnp.roll(times, 1), 0),
        valid=valid,
        count=jnp.sum(valid, dtype=jnp.int32),
    )


def throughput(found: Passages, periods: Float[Array, " a"]) -> Float[Array, " c"]:
    """Passages per second in each of the A - 1 intervals between given times [s]. Not differentiable.

    Args: found, the passages of a station; periods [A] s, the given times.
    """
    within = (found.time[None] >= periods[:-1, None]) & (found.time[None] < periods[1:, None]) & found.valid[None]
    return safe.divide(jnp.sum(within, axis=1, dtype=periods.dtype), periods[1:] - periods[:-1])


def travel_times(
    way: Float[Array, "v t"],
    time: Float[Array, " t"],
    *,
    mask: Bool[Array, "v t"],
    start: float | Float[Array, ""],
    end: float | Float[Array, ""],
    margin: float | Float[Array, ""] = 2.0,
) -> tuple[Float[Array, " v"], Bool[Array, " v"]]:
    """Seconds [V] from passing one station [m] to passing another, and whether both were seen. Differentiable.

    Args: way [V, T] m; time [T] s; mask [V, T], samples that count; start, end, the stations [m]; margin [m] beyond
    each at which it has been passed.
    """
    stations = jnp.stack([jnp.asarray(start, way.dtype), jnp.asarray(end, way.dtype)])
    found = jax.vmap(lambda w, m: crossings(w, time, mask=m, stations=stations, margin=margin))(way, mask)
    both = found.valid[:, 0] & found.valid[:, 1]
    return jnp.where(both, found.time[:, 1] - found.time[:, 0], 0), both


def gini(values: Float[Array, "*b n"], mask: Bool[Array, "*b n"]) -> Float[Array, "*b"]:
    """Gini coefficient of non-negative values, such as travel times: 0 if all are equal, (n - 1) / n if one has all.

        G = sum_i (2 i - n - 1) x_(i) / (n sum_i x_i)

    0 without a value or where all are 0. Differentiable where no two values are equal.
    Args: values [..., N]; mask [..., N], values that count.
    """
    n = jnp.sum(mask, axis=-1, keepdims=True, dtype=values.dtype)
    ordered = jnp.sort(jnp.where(mask, values, jnp.inf), axis=-1)
    rank = jnp.broadcast_to(jnp.arange(values.shape[-1], dtype=values.dtype) + 1, values.shape)
    ordered = jnp.where(rank <= n, ordered, 0)
    weighted = masked.mean((2 * rank - n - 1) * ordered, rank <= n)
    return safe.divide(weighted, jnp.sum(ordered, axis=-1))
