"""How sure an estimate is: intervals from half samples of blocks, and what swapping laps alone would give.

Both take a statistic, a function of the mask [t, n] of the samples that count, which returns values [*q] and whether
they are valid [*q]: a divergence, a distance, or any other comparison of teams.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Bool, Float, Int

from urbanjax.types import INSIDE, field, pytree, static

Statistic = Callable[[Any], tuple[Any, Any]]


@pytree
class ResamplingParams:
    """How intervals are found."""

    draws: int = static(default=100, metadata={"range": (2, 10_000)})
    blocks: int = static(default=40, metadata={"range": (2, 10_000)})  # of consecutive samples, kept or left together
    level: float = field(default=0.95, metadata=INSIDE)  # nominal coverage


@pytree
class Interval:
    """Of values [*q]; NaN where not valid."""

    low: Array  # [*q]
    high: Array  # [*q]
    deviation: Array  # [*q], standard deviation of the estimate
    valid: Array  # [*q] bool: all draws were


@pytree
class LapSwap:
    """What the same laps give when they are dealt out anew. Of values [*q]; excess and share NaN where not valid."""

    observed: Array  # [*q], laps as they were driven
    null: Array  # [s, *q], laps dealt out otherwise
    excess: Array  # [*q], observed less the mean of all deals
    share: Array  # [*q] of the deals that give at least as much as observed, itself included: the p-value
    valid: Array  # [*q] bool


def consecutive(valid: Bool[Array, "t n"], blocks: int) -> Int[Array, "t n"]:
    """The block of each valid sample: as many consecutive ones in each.

    Args: valid [T, N], samples that count; blocks, their number.
    """
    rank = jnp.cumsum(valid, axis=-1, dtype=jnp.int32) - 1
    count = jnp.maximum(rank[:, -1:] + 1, 1)
    # In floats, for a product of rank and blocks may be too large for an integer.
    return jnp.clip(jnp.floor(rank * (blocks / count)).astype(jnp.int32), 0, blocks - 1)


def interval(
    statistic: Statistic,
    valid: Bool[Array, "t n"],
    *,
    block: Int[Array, "t n"],
    key: Array,
    params: ResamplingParams,
    paired: bool = False,
) -> Interval:
    """An interval for a statistic of dependent samples, by random half samples of blocks (Saigo, Shao and Sitter 2001).

    Each draw keeps half of the blocks of each team. Nothing is drawn twice: copies would be neighbours at distance 0.
    Half of the samples vary with twice the variance, and around the whole with once that, so the spread of the draws is
    that of the estimate; its bias is not part of it.
    Args: statistic, of a mask [T, N]; valid [T, N], samples that count; block [T, N] of each sample, in [0,
    params.blocks); key, of jax.random; paired, whether all teams keep the same blocks (blocks of stations rather than
    of time).
    """
    value, good = statistic(valid)
    drawn, fine = lax.map(statistic, half_samples(valid, block, key=key, params=params, paired=paired))
    return spread(value, good, drawn=drawn, fine=fine, params=params)


def half_samples(
    valid: Bool[Array, "t n"], block: Int[Array, "t n"], *, key: Array, params: ResamplingParams, paired: bool = False
) -> Bool[Array, "s t n"]:
    """The masks of the draws of `interval`, for statistics that are found one by one.

    Args: valid, block [T, N], key and paired, as of `interval`.
    """
    teams = 1 if paired else valid.shape[0]

    def draw(key: Array) -> Array:
        places = jax.vmap(lambda k: jax.random.permutation(k, params.blocks))(jax.random.split(key, teams))
        kept = jnp.broadcast_to(places < params.blocks // 2, (valid.shape[0], params.blocks))
        return valid & jnp.take_along_axis(kept, block, axis=1)

    return lax.map(draw, jax.random.split(key, params.draws))


def spread(
    value: Float[Array, "*q"],
    good: Bool[Array, "*q"],
    *,
    drawn: Float[Array, "s *q"],
    fine: Bool[Array, "s *q"],
    params: ResamplingParams,
) -> Interval:
    """The interval around a value, from those of its half samples; good and fine, which values are valid.

    Args: value, good [*q], of the whole; drawn, fine [S, *q], of its half samples.
    """
    half = params.blocks // 2
    around = (drawn - jnp.mean(drawn, axis=0, keepdims=True)) * (half / (params.blocks - half)) ** 0.5
    tail = (1 - jnp.asarray(params.level, value.dtype)) / 2
    low, high = (jnp.quantile(around, q, axis=0) for q in (tail, 1 - tail))
    valid = good & jnp.all(fine, axis=0)

    def known(x: Array) -> Array:
        return jnp.where(valid, x, jnp.nan)

    return Interval(known(value - high), known(value - low), known(jnp.std(around, axis=0, ddof=1)), valid)


def lap_swap(
    statistic: Statistic, lap: Int[Array, " n"], *, valid: Bool[Array, " n"], deals: Bool[Array, "s l"]
) -> LapSwap:
    """The statistic of two teams whose laps are dealt out in every way given, the first being how they were driven.

    Under the hypothesis that both drive alike all deals are equally likely, and biases of the estimate (regular
    spacing along a curve, dependence within a lap) are the same in all.
    Args: statistic, which gets masks [2, N]; lap [N] of each sample of the pooled laps; valid [N], samples that count;
    deals [S, L], which of the L laps the first team gets, the second gets the rest.
    """

    def deal(first: Array) -> tuple[Array, Array]:
        mine = first[lap]
        return statistic(jnp.stack([valid & mine, valid & ~mine]))

    values, fine = lax.map(deal, deals)
    observed = values[0]
    # The same deal found twice would differ by rounding only.
    slack = 1e-5 * (1 + jnp.abs(observed))
    share = jnp.mean((values >= (observed - slack)[None]).astype(values.dtype), axis=0)
    valid = jnp.all(fine, axis=0)
    excess, share = (jnp.where(valid, x, jnp.nan) for x in (observed - jnp.mean(values, axis=0), share))
    return LapSwap(observed, values[1:], excess, share, valid)
