"""Lane changes from lanes over time: those that last. One vehicle at a time; batches go through vmap."""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int

from urbanjax.numerics import masked
from urbanjax.types import pytree


@pytree
class Changes:
    """Lane changes of one vehicle."""

    lane: Array  # [T] int32, lane with the short visits to others left out
    at: Array  # [T] bool, first sample in a new lane
    step: Array  # [T] int32, lane entered less lane left; 0 where there is no change
    count: Array  # [] int32
    begun: Array  # [] bool, the series ends in another lane that has not yet been held long enough


def lane_changes(
    lane: Int[Array, " t"], time: Float[Array, " t"], *, mask: Bool[Array, " t"], hold: float | Float[Array, ""] = 1.0
) -> Changes:
    """Changes to a lane that is then held for a time [s], each at the first sample in it.

    Samples that do not count neither confirm nor end anything. The lane of the first sample that counts is taken as it
    is. Not differentiable.
    Args: lane [T], in any numbering; time [T] s; mask [T], samples that count; hold [s].
    """
    first = lane[jnp.argmax(mask)]
    n = lane.shape[0]

    def look(carry: tuple[Array, Array, Array], sample: tuple[Array, ...]) -> tuple[tuple[Array, Array, Array], tuple]:
        settled, other, since = carry
        i, now, counts = sample
        away = counts & (now != settled)
        since = jnp.where(away & (now != other), i, since)
        other = jnp.where(counts, now, other)
        held = away & (time[i] - time[since] >= hold)
        step = jnp.where(held, now - settled, 0)
        return (jnp.where(held, now, settled), other, since), (held, since, step)

    index = jnp.arange(n, dtype=jnp.int32)
    start = (first, first, jnp.zeros((), jnp.int32))
    (settled, other, _), (held, since, step) = jax.lax.scan(look, start, (index, lane, mask))
    # The change is told when it is confirmed, and belongs to the sample it began with.
    step = jnp.zeros(n, lane.dtype).at[jnp.where(held, since, n)].add(step, mode="drop")
    at = jnp.zeros(n, bool).at[jnp.where(held, since, n)].set(True, mode="drop")
    return Changes(
        lane=first + jnp.cumsum(step),
        at=at,
        step=step,
        count=jnp.sum(at, dtype=jnp.int32),
        begun=other != settled,
    )


def lanes_of(
    offset: Float[Array, " t"],
    mask: Bool[Array, " t"],
    *,
    borders: Float[Array, " b"],
    margin: float | Float[Array, ""] = 0.3,
) -> Int[Array, " t"]:
    """Lane of each sample from its lateral position: lane i lies between borders i - 1 and i.

    Lane 0 is beyond the first border and lane B beyond the last. A lane is left only when its border is behind by the
    margin; a sample that does not count keeps the lane before it. Not differentiable.
    Args: offset [T] m; mask [T], samples that count; borders [B] m, increasing; margin [m].
    """
    low = jnp.concatenate([jnp.full(1, -jnp.inf, borders.dtype), borders]) - margin
    high = jnp.concatenate([borders, jnp.full(1, jnp.inf, borders.dtype)]) + margin
    plain = jnp.sum(offset[:, None] >= borders[None], axis=1, dtype=jnp.int32)
    plain = plain[masked.latest(mask)]

    def look(lane: Array, sample: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        now, place, counts = sample
        leaves = counts & ((place < low[lane]) | (place > high[lane]))
        lane = jnp.where(leaves, now, lane)
        return lane, lane

    return jax.lax.scan(look, plain[0], (plain, jnp.where(mask, offset, 0), mask))[1]
