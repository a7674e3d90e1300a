"""String stability of a platoon in the time domain: does a disturbance grow from vehicle to vehicle?

A gain above 1 says that it does. Vehicles are rows in the order they drive in; a row without a sample is absent, and
the vehicle behind it is compared with the next one ahead of that. Batches go through vmap.
"""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int

from urbanjax.numerics import masked, safe
from urbanjax.traffic.bootstrap import blocks
from urbanjax.types import pytree


@pytree
class Gains:
    """Deviations of speed from each vehicle's mean, and what they become from one vehicle to the next."""

    spread: Array  # [V] m/s, standard deviation of the vehicle's own samples
    peak: Array  # [V] m/s, greatest deviation among them
    l2: Array  # [V] ratio of standard deviations to the vehicle ahead, over the samples of both
    linf: Array  # [V] ratio of greatest deviations, likewise
    pair: Array  # [V] bool, there is a vehicle ahead, with samples in common
    chain_l2: Array  # [] the same ratios of the last vehicle to the first
    chain_linf: Array  # []
    chain: Array  # [] bool, there is a first and another last vehicle, with samples in common


def ahead(present: Bool[Array, " v"]) -> tuple[Int[Array, " v"], Bool[Array, " v"]]:
    """Row of the next vehicle ahead that is present (0 if none), and whether the vehicle and that one are there.

    Args: present [V], in the order they drive in, the first one in front.
    """
    before = jnp.concatenate([jnp.zeros_like(present[:1]), present[:-1]])
    row = jnp.maximum(masked.latest(before) - 1, 0)
    some = jnp.cumsum(before) > 0
    return row, present & some


def gains(speed: Float[Array, "v t"], mask: Bool[Array, "v t"]) -> Gains:
    """Ratios of standard deviations (L2) and of greatest deviations (Linf) of speed, pair by pair and head to tail.

    Each pair is compared over the samples that both have, and each deviation is from the mean over those. Ratios are 0
    where the vehicle ahead never deviates or there is none. Differentiable in the speeds away from standstill.
    Args: speed [V, T] m/s; mask [V, T], samples that count.
    """
    row, pair = ahead(jnp.any(mask, axis=1))
    both = mask & mask[row] & pair[:, None]
    l2, linf = _ratios(speed, speed[row], both)
    first = jnp.argmax(jnp.any(mask, axis=1))
    last = masked.latest(jnp.any(mask, axis=1))[-1]
    ends = mask[first] & mask[last] & (first != last)
    chain_l2, chain_linf = _ratios(speed[last], speed[first], ends)
    return Gains(
        spread=masked.std(speed, mask),
        peak=masked.largest(jnp.abs(masked.deviation(speed, mask)), mask),
        l2=l2,
        linf=linf,
        pair=jnp.any(both, axis=1),
        chain_l2=chain_l2,
        chain_linf=chain_linf,
        chain=jnp.any(ends),
    )


def bootstrapped(
    key: Array,
    speed: Float[Array, "v t"],
    *,
    mask: Bool[Array, "v t"],
    block: int,
    draws: int,
    level: float | Float[Array, ""] = 0.9,
) -> tuple[Float[Array, "v 2"], Float[Array, "2"]]:
    """Intervals of the L2 gains [V, 2] and of the head-to-tail one [2], by blocks of time drawn together.

    All vehicles share the blocks, so what they share stays shared; the block has to outlast the way of a disturbance
    down the platoon. The greatest deviation has no such interval: a resampled maximum never exceeds the one seen.
    Args: key, of jax.random; speed [V, T] m/s; mask [V, T], samples that count; block [samples]; draws, number of
    resampled logs; level, probability within the interval.
    """
    index = blocks(key, speed.shape[1], block=block, draws=draws)

    def drawn(at: Array) -> tuple[Array, Array]:
        found = gains(speed[:, at], mask[:, at])
        return found.l2, found.chain_l2

    pairs, chain = jax.lax.map(drawn, index)
    every = jnp.ones(draws, bool)
    levels = (0.5 - 0.5 * level, 0.5 + 0.5 * level)
    each = [masked.quantile(pairs.T, jnp.broadcast_to(every, pairs.T.shape), level=at) for at in levels]
    return jnp.stack(each, axis=-1), jnp.stack([masked.quantile(chain, every, level=at) for at in levels])


def _ratios(rear: Array, front: Array, both: Array) -> tuple[Array, Array]:
    spreads = [masked.std(x, both) for x in (rear, front)]
    peaks = [masked.largest(jnp.abs(masked.deviation(x, both)), both) for x in (rear, front)]
    return safe.divide(spreads[0], spreads[1]), safe.divide(peaks[0], peaks[1])
