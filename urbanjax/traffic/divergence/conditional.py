"""Divergence of the lateral offset given the place along a reference line, P(x | z): what Eq. 30 asks for."""

import jax
import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Bool, Float, Int

from urbanjax.numerics import safe
from urbanjax.traffic.divergence import ties
from urbanjax.traffic.divergence.estimate import DivergenceParams, all_pairs
from urbanjax.traffic.divergence.neighbours import Pairs
from urbanjax.types import pytree


@pytree
class Conditional:
    """Divergences given the station bin. Of P pairs of teams, K values of k and B bins."""

    value: Array  # [P, K] nats: the mean over the samples in bins that count; NaN, with derivative 0, where not valid
    valid: Array  # [P, K] bool
    share: Array  # [P, K] of the samples that are in such bins
    by_bin: Array  # [P, K, B] nats; NaN, with derivative 0, in bins that do not count
    bins: Array  # [P, K, B] bool, which bins count: at least k + 1 samples of the first team, k of the second
    ties: Array  # [P, K] int32, samples at distance 0 from a k-th neighbour


def conditional(
    offset: Float[Array, "t n"],
    station_bin: Int[Array, "t n"],
    *,
    valid: Bool[Array, "t n"],
    bins: int,
    params: DivergenceParams,
    pairs: Pairs | None = None,
    key: Array | None = None,
) -> Conditional:
    """D(P_i(d | z) || P_j(d | z)) for each ordered pair: one-dimensional estimates per bin, weighted by n_bin / n.

    The corrected form throughout. Differentiable in the offsets with the neighbours held. NaN where there is no
    estimate, as of `estimate.divergence`; not valid where a sample of either team is not finite.
    Args: offset [T, N] m; station_bin [T, N] in [0, bins); valid [T, N], samples that count; bins, their number; pairs
    of teams (i, j) (None: all); key, of jax.random, for the policy `jitter`.
    """
    pairs = all_pairs(offset.shape[0]) if pairs is None else pairs
    held, valid, whole = ties.finite(offset[..., None], valid)
    offset = held[..., 0]
    if params.ties == "dedupe":
        places = jnp.stack([station_bin.astype(offset.dtype), offset], axis=-1)
        valid = valid & ~jax.vmap(ties.duplicates)(places, valid)
    else:
        size = jnp.asarray(params.size, offset.dtype)
        offset = ties.separated(offset[..., None], valid, policy=params.ties, size=size, key=key)[0][..., 0]
    station_bin = jnp.where(valid, station_bin, bins)
    order = lax.stop_gradient(jax.vmap(lambda b, x: jnp.lexsort((x, b)))(station_bin, offset))
    offset, station_bin = (jnp.take_along_axis(x, order, axis=1) for x in (offset, station_bin))

    def pair(teams: tuple[Array, Array]) -> Conditional:
        i, j = teams
        found = _pair(offset[i], station_bin[i], offset[j], station_bin[j], bins, params)
        valid = found.valid & whole[i] & whole[j]
        return found.replace(valid=valid, value=jnp.where(valid, found.value, jnp.nan))

    return lax.map(pair, tuple(jnp.asarray(team) for team in zip(*pairs, strict=True)))


def _pair(x: Array, x_bin: Array, y: Array, y_bin: Array, bins: int, params: DivergenceParams) -> Conditional:
    """One pair of teams, whose samples are sorted by bin and offset."""
    n, most = x.shape[0], max(params.ks)
    here = jnp.arange(n, dtype=jnp.int32)
    own = _window(x, x_bin, x, x_bin, [here + w for w in range(-most, most + 1) if w])
    place = lax.stop_gradient(_place(x, x_bin, y, y_bin))
    other = _window(x, x_bin, y, y_bin, [place + w for w in range(-most, most)])
    size = jnp.asarray(params.size, x.dtype)
    count_x, count_y = (jnp.zeros(bins + 1, jnp.int32).at[b].add(1)[:bins] for b in (x_bin, y_bin))
    results = []
    for k in params.ks:
        r, s = own[k - 1], other[k - 1]
        enough = (count_x > k) & (count_y >= k)
        used = (x_bin < bins) & enough[jnp.minimum(x_bin, bins - 1)]
        r, s = (jnp.where(used, distance, 1) for distance in (r, s))
        tied = jnp.sum(used & ((r == 0) | (s == 0)), dtype=jnp.int32)
        r, s, used = ties.counted(r, s, used=used, policy=params.ties, size=size)
        terms = jnp.where(used, jnp.log(s / r), 0)
        counted = jnp.zeros(bins + 1, x.dtype).at[x_bin].add(used.astype(x.dtype))[:bins]
        total = jnp.zeros(bins + 1, x.dtype).at[x_bin].add(terms)[:bins]
        sizes = jnp.log(jnp.maximum(count_y, 1) / jnp.maximum(count_x - 1, 1)).astype(x.dtype)
        enough = enough & (counted > 0)
        by_bin = safe.divide(total, counted) + sizes
        value = safe.divide(jnp.sum(counted * by_bin), jnp.sum(counted))
        valid = jnp.any(enough) & ((tied == 0) | (params.ties != "error"))
        share = safe.divide(jnp.sum(counted), jnp.sum(count_x).astype(x.dtype))
        results.append(Conditional(value, valid, share, jnp.where(enough, by_bin, jnp.nan), enough, tied))
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *results)


def _window(x: Array, x_bin: Array, y: Array, y_bin: Array, places: list[Array]) -> Array:
    """Distances [W, n], ascending, to the samples at W places that are in the same bin; inf where there is none."""
    inside = [(place >= 0) & (place < y.shape[0]) for place in places]
    places = [jnp.clip(place, 0, y.shape[0] - 1) for place in places]
    away = [jnp.abs(x - y[p]) for p in places]
    return jnp.sort(
        jnp.stack(
            [jnp.where(i & (y_bin[p] == x_bin), a, jnp.inf) for i, p, a in zip(inside, places, away, strict=True)]
        ),
        axis=0,
    )


def _place(x: Array, x_bin: Array, y: Array, y_bin: Array) -> Array:
    """How many y come before each x, in the order of bin and offset."""
    n = x.shape[0]
    late = jnp.concatenate([jnp.ones(n, jnp.int32), jnp.zeros(y.shape[0], jnp.int32)])
    order = jnp.lexsort((late, jnp.concatenate([x, y]), jnp.concatenate([x_bin, y_bin])))
    before = jnp.cumsum(order >= n, dtype=jnp.int32)
    return jnp.zeros(n + y.shape[0], jnp.int32).at[order].set(before)[:n]
