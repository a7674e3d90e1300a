"""Which sample is the k-th nearest, within a team and among another's."""

import operator

import jax
import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Bool, Float, Int

from urbanjax.numerics import safe
from urbanjax.numerics import tree as trees
from urbanjax.numerics.exact_nearest import nearest_among

FINE = 3  # passes of sorting: samples lie so densely along curves that two do not tell them apart
Pairs = tuple[tuple[int, int], ...]


def neighbours(
    points: Float[Array, "t n d"], valid: Bool[Array, "t n"], *, pairs: Pairs, ranks: tuple[int, ...]
) -> Int[Array, "p r n"]:
    """The k-th nearest sample of team j to each sample of team i, itself left out where i = j, for each pair (i, j).

    Exact (two samples whose squared distances differ by less than 1e-5 of them may change places), in time and memory
    linear in n for points of bounded density. An index is n where there are fewer than k, and for invalid samples. Not
    differentiable.
    Args: points [T, N, D] m, close enough to the origin for their precision; valid [T, N], samples that count; pairs of
    teams (i, j); ranks, the values of k.
    """
    points = lax.stop_gradient(points)
    depth, most = trees.depth(points.shape[1]), max(ranks)
    forest = lax.map(lambda team: trees.build(team[0].T, team[1], levels=depth, passes=FINE), (points, valid))

    def search(pair: tuple[Array, Array]) -> Array:
        own, other = (jax.tree.map(operator.itemgetter(team), forest) for team in pair)
        found, _ = nearest_among(own, other, k=most + 1)
        # A sample is its own nearest one, or ties with it.
        return found[jnp.asarray(ranks) - (pair[0] != pair[1]).astype(int)]

    first, second = (jnp.asarray(team, jnp.int32) for team in zip(*pairs, strict=True))
    return lax.map(search, (first, second))


def distances(
    points: Float[Array, "t n d"], pairs: Pairs, *, index: Int[Array, "p r n"]
) -> tuple[Float[Array, "p r n"], Bool[Array, "p r n"]]:
    """Distance [m] of each sample to the one of that index, 0 where there is none, and where there is one.

    Differentiable in both points with the neighbours held; derivative 0 where they coincide.
    Args: points [T, N, D] m; pairs of teams (i, j); index [P, R, N], as of `neighbours`.
    """
    first, second = (jnp.asarray(team, jnp.int32) for team in zip(*pairs, strict=True))
    found = index < points.shape[1]
    neighbour = points[second[:, None, None], jnp.where(found, index, 0)]
    return safe.norm(jnp.where(found[..., None], points[first][:, None] - neighbour, 0)), found
