"""The cheapest way through a layered graph, and its soft twin."""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import soft
from urbanjax.numerics.soft import Relaxation


def layered_search(
    start_cost: Float[Array, "m"],
    edge_cost: Float[Array, "e m m"],
    *,
    relaxation: Relaxation,
    scale: float | Array = 1.0,
) -> tuple[Float[Array, ""], Float[Array, "s m"], Float[Array, "e m m"]]:
    """Cost of the best path through S = e + 1 layers of M nodes, and how much each node and edge is on it (Eq. 15).

    Exact dynamic programming, V_i(j) = min_k c_i(j, k) + V_i+1(k); the printed argmin over single nodes is read as one
    over paths. Soft: V_i(j) = -T log sum_k exp(-(c_i(j, k) + V_i+1(k)) / T), so that V_hard - T log(paths) <= V and
    V <= V_hard, and the node and edge weights are the marginals of the Gibbs distribution over paths, dV/dc.
    Args: start_cost [M], to each node of the first layer; edge_cost [S-1, M, M], from row to column, finite;
    relaxation, of the minimum; scale, cost that counts as clearly cheaper.
    Returns: value; node weights [S, M], each row summing to 1; edge weights [S-1, M, M].
    """

    def backward(value: Array, cost: Array) -> tuple[Array, Array]:
        through = cost + value[None, :]
        return soft.minimum(through, relaxation, scale=scale), soft.choose(through, relaxation, scale=scale)

    def forward(node: Array, step: Array) -> tuple[Array, tuple[Array, Array]]:
        edge = node[:, None] * step
        following = jnp.sum(edge, axis=0)
        return following, (following, edge)

    to_go, steps = jax.lax.scan(backward, jnp.zeros_like(start_cost), edge_cost, reverse=True)
    total = start_cost + to_go
    first = soft.choose(total, relaxation, scale=scale)
    _, (nodes, edges) = jax.lax.scan(forward, first, steps)
    return soft.minimum(total, relaxation, scale=scale), jnp.concatenate([first[None], nodes]), edges


def closed_search(
    edge_cost: Float[Array, "s m m"],
    relaxation: Relaxation,
    *,
    scale: float | Array = 1.0,
    barred: float = 1e6,
) -> tuple[Float[Array, ""], Float[Array, "s m"], Float[Array, "s m m"]]:
    """Cost of the best way round a closed course of S layers, back to the node where it began, and its weights.

    As `layered_search`, over all closed paths: the last layer leads to the first one. Args: edge_cost [S, M, M],
    finite; relaxation, of the minimum; scale, cost that counts as clearly cheaper; barred, added to ends beside the
    start, more than any path costs.
    Returns: value; node weights [S, M]; edge weights [S, M, M].
    """
    others = barred * (1 - jnp.eye(edge_cost.shape[1], dtype=edge_cost.dtype))

    def from_node(other: Array) -> tuple[Array, Array, Array]:
        ended = edge_cost.at[-1].add(other[None, :])
        value, nodes, edges = layered_search(other, ended, relaxation=relaxation, scale=scale)
        return value, nodes[:-1], edges

    values, nodes, edges = jax.vmap(from_node)(others)
    first = soft.choose(values, relaxation, scale=scale)
    return (
        soft.minimum(values, relaxation, scale=scale),
        jnp.tensordot(first, nodes, axes=1, precision=jax.lax.Precision.HIGHEST),
        jnp.tensordot(first, edges, axes=1, precision=jax.lax.Precision.HIGHEST),
    )
