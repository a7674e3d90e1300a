"""Divergence of positions between teams, from distances to their k-th nearest neighbours (Eq. 30-32)."""

import math

import jax.numpy as jnp
from jax import Array
from jax.scipy.special import digamma
from jaxtyping import Bool, Float

from urbanjax.numerics import masked
from urbanjax.traffic.divergence import ties
from urbanjax.traffic.divergence.neighbours import Pairs, distances, neighbours
from urbanjax.types import field, pytree, static

FORMS = ("corrected", "printed", "adaptive")
WIDEST = 16  # neighbours that the adaptive form counts among


@pytree
class DivergenceParams:
    """What is estimated, and what is done about samples that coincide."""

    ks: tuple[int, ...] = static(default=(5,))  # neighbours; each gives an estimate
    form: str = static(default="corrected", metadata={"choices": FORMS})  # adaptive takes no k
    ties: str = static(default="error", metadata={"choices": ties.POLICIES})
    size: float = field(default=1e-3, metadata={"range": (0.0, math.inf)})  # m: floor, or half width of the jitter


@pytree
class Estimate:
    """Divergences, and what they stand on. Of P pairs of teams and K values of k."""

    value: Array  # [P, K] nats; NaN, with derivative 0, where not valid
    valid: Array  # [P, K] bool: enough samples, all finite, and no ties under the policy `error`
    terms: Array  # [P, K, n] nats, whose mean over `used` is the value; 0 elsewhere
    used: Array  # [P, K, n] bool, samples that count
    ties_own: Array  # [P, K] int32, samples at distance 0 from their k-th neighbour in their own team
    ties_other: Array  # [P, K] int32, the same in the other team
    dropped: Array  # [T] int32, samples that repeated another one and were left out


def all_pairs(teams: int) -> Pairs:
    """Every ordered pair of different teams, row by row.

    Args: teams, their number.
    """
    return tuple((i, j) for i in range(teams) for j in range(teams) if i != j)


def divergence(
    points: Float[Array, "t n d"],
    valid: Bool[Array, "t n"],
    *,
    params: DivergenceParams,
    pairs: Pairs | None = None,
    key: Array | None = None,
) -> Estimate:
    """Estimates of D(P_i || P_j) from the samples of teams i and j, for each ordered pair (None: all), in one program.

    `corrected`: (d/n) sum log(s_k / r_k) + log(m / (n - 1)) (Wang, Kulkarni and Verdu 2009), where r_k is the distance
    of a sample to its k-th neighbour in its own team and s_k in the other. Not clamped: estimates may be negative.
    `printed`: Eq. 31 as it stands, which lacks the factor d, has r / s the wrong way round, weights by the density of
    Eq. 32 and, giving P the m samples and Q the n, swaps the two in both. `adaptive`: k by sample, so that both
    distances are about the same: as little bias as k = 1 where densities differ, with less spread. docs/divergence.md
    states the errors of all. Differentiable in the points with the neighbours held.
    No estimate is NaN beside `valid` false, since any number would be read as one (0 as identical): the exception to
    the rule that no NaN leaves a function.
    Args: points [T, N, D] m, near the origin; valid [T, N], samples that count; pairs of teams (i, j); key, of
    jax.random, for the policy `jitter`. Raises ValueError where the key is missing.
    """
    pairs = all_pairs(points.shape[0]) if pairs is None else pairs
    size = jnp.asarray(params.size, points.dtype)
    points, valid, whole = ties.finite(points, valid)
    count = jnp.sum(valid, axis=-1, dtype=jnp.int32)
    points, valid = ties.separated(points, valid, policy=params.ties, size=size, key=key)
    dropped = count - jnp.sum(valid, axis=-1, dtype=jnp.int32)
    r, s, used = _distances(points, valid, pairs, params)
    correction = jnp.zeros_like(r)
    if params.form == "adaptive":
        r, s, correction = _levelled(r, s)
    coincide = [jnp.sum(used & (distance == 0), axis=-1, dtype=jnp.int32) for distance in (r, s)]
    r, s, used = ties.counted(r, s, used=used, policy=params.ties, size=size)
    first, second = (jnp.asarray(team) for team in zip(*pairs, strict=True))
    n, m = ((count - dropped)[team][:, None, None].astype(r.dtype) for team in (first, second))
    if params.form == "printed":
        n, m = m, n
    sizes = jnp.log(jnp.maximum(m, 1)) - jnp.log(jnp.maximum(n - 1, 1))
    if params.form == "printed":
        density = _density(r, jnp.asarray(params.ks, r.dtype)[None, :, None], n, points.shape[2])
        weights = density * jnp.sum(used, axis=-1, keepdims=True)  # the mean of the terms is the printed sum
        terms = weights * jnp.log(r / s) + sizes
    else:
        terms = points.shape[2] * jnp.log(s / r) + correction + sizes
    enough = jnp.any(used, axis=-1) & (whole[first] & whole[second])[:, None]
    if params.ties == "error":
        enough = enough & (coincide[0] + coincide[1] == 0)
    value = jnp.where(enough, masked.mean(terms, used), jnp.nan)
    return Estimate(value, enough, jnp.where(used, terms, 0), used, coincide[0], coincide[1], dropped)


def _distances(points: Array, valid: Array, pairs: Pairs, params: DivergenceParams) -> tuple[Array, Array, Array]:
    """Distances [P, K, n] of each pair's samples to their neighbours in the own and the other team, and which count."""
    ranks = tuple(range(1, WIDEST + 1)) if params.form == "adaptive" else params.ks
    teams = sorted({i for i, _ in pairs})
    searched = tuple((i, i) for i in teams) + pairs
    away, found = distances(points, searched, index=neighbours(points, valid, pairs=searched, ranks=ranks))
    own = jnp.asarray([teams.index(i) for i, _ in pairs])
    used = found[own] & found[len(teams) :]
    if params.form == "adaptive":
        used = jnp.all(used, axis=1, keepdims=True)
    return away[own], away[len(teams) :], used


def _density(r: Array, k: Array, n: Array, d: int) -> Array:
    """Eq. 32: the density [1/m^d] by the volume of the ball that reaches to the k-th neighbour."""
    return k / (jnp.maximum(n - 1, 1) * (math.pi ** (d / 2) / math.gamma(d / 2 + 1)) * r**d)


def _levelled(r: Float[Array, "p w n"], s: Float[Array, "p w n"]) -> tuple[Array, Array, Array]:
    """Distances to the farthest neighbours within the larger nearest distance, and what their ranks correct.

    The rank is data-dependent, of at most WIDEST neighbours, as in section IV of Wang, Kulkarni and Verdu (2009).
    """
    reach = jnp.maximum(r[:, :1], s[:, :1])
    chosen = []
    correction = jnp.zeros_like(reach)
    for distance, sign in ((r, 1), (s, -1)):
        rank = jnp.sum(distance <= reach, axis=1, keepdims=True, dtype=jnp.int32)
        chosen.append(jnp.take_along_axis(distance, rank - 1, axis=1))
        correction = correction + sign * digamma(rank.astype(r.dtype))
    return chosen[0], chosen[1], correction
