"""How many dimensions the samples really fill: a route fills about one, whatever the plane has."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.numerics import masked, safe
from urbanjax.traffic.divergence.neighbours import distances, neighbours


def effective_dimension(points: Float[Array, "t n d"], valid: Bool[Array, "t n"], *, k: int = 10) -> Float[Array, " t"]:
    """Maximum-likelihood dimension of each team's samples at the scale of their k nearest neighbours.

    Levina and Bickel (2004), averaged as by MacKay and Ghahramani: the inverse of the mean of log(r_k / r_j) over j < k
    and all samples; those with fewer than k neighbours, or at distance 0 from one, are left out. 0 where none is left.
    Args: points [T, N, D] m; valid [T, N], samples that count; k, number of neighbours.
    """
    pairs = tuple((i, i) for i in range(points.shape[0]))
    ranks = tuple(range(1, k + 1))
    away, found = distances(points, pairs, index=neighbours(points, valid, pairs=pairs, ranks=ranks))
    used = jnp.all(found & (away > 0), axis=1)
    logs = jnp.log(jnp.where(used[:, None], away, 1))
    return safe.divide(jnp.ones((), points.dtype), masked.mean(logs[:, -1] - jnp.mean(logs[:, :-1], axis=1), used))
