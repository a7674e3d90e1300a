"""The cheapest way through a layered graph, and its soft twin."""

import functools

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import lean, safe, soft
from urbanjax.numerics.kept import kept
from urbanjax.numerics.soft import Relaxation
from urbanjax.types import pytree


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
    if relaxation.mode == "hard":
        return _cheapest(start_cost, edge_cost)
    temperature = jnp.asarray(relaxation.temperature * scale, edge_cost.dtype)
    return _relaxed(start_cost, edge_cost, temperature, relaxation.mode)


def _cheapest(start_cost: Array, edge_cost: Array) -> tuple[Array, Array, Array]:
    """What `layered_search` returns in mode hard: one way, so that numbers of nodes are all that need be kept."""

    def backward(value: Array, cost: Array) -> tuple[Array, Array]:
        through = cost + value[None, :]
        return safe.minimum(through), lean.argmin(through)

    def forward(node: Array, best: Array) -> tuple[Array, Array]:
        following = lean.rows(best, node)
        return following, following

    to_go, best = jax.lax.scan(backward, jnp.zeros_like(start_cost), edge_cost, reverse=True)
    total = start_cost + to_go
    first = lean.argmin(total)
    _, others = jax.lax.scan(forward, first, best)
    nodes = jax.nn.one_hot(jnp.concatenate([first[None], others]), total.shape[0], dtype=total.dtype)
    return safe.minimum(total), nodes, nodes[:-1, :, None] * nodes[1:, None, :]


@pytree
class Trail:
    """What the search went by."""

    ahead: Array  # [e, M] cost to go from the end of each edge
    shares: Array  # [e, M, M] how much of what begins at a node takes each edge
    total: Array  # [M] cost of the best path by its first node


def searched(
    start_cost: Array, edge_cost: Array, *, relaxation: Relaxation
) -> tuple[tuple[Array, Array, Array], Trail]:
    """What `layered_search` returns in any mode, and how it came about, which differentiates itself.

    Args: start_cost [M]; edge_cost [S-1, M, M]; relaxation, whose temperature is in units of cost.
    """

    def backward(value: Array, cost: Array) -> tuple[Array, tuple[Array, Array]]:
        through = cost + value[None, :]
        return soft.minimum(through, relaxation), (value, soft.choose(through, relaxation))

    def forward(node: Array, step: Array) -> tuple[Array, tuple[Array, Array]]:
        edge = node[:, None] * step
        following = jnp.sum(edge, axis=0)
        return following, (following, edge)

    to_go, (ahead, shares) = jax.lax.scan(backward, jnp.zeros_like(start_cost), edge_cost, reverse=True)
    total = start_cost + to_go
    first = soft.choose(total, relaxation)
    _, (nodes, edges) = jax.lax.scan(forward, first, shares)
    return (soft.minimum(total, relaxation), jnp.concatenate([first[None], nodes]), edges), Trail(ahead, shares, total)


@functools.partial(jax.custom_jvp, nondiff_argnums=(3,))
def _relaxed(start_cost: Array, edge_cost: Array, temperature: Array, mode: str) -> tuple[Array, Array, Array]:
    return searched(start_cost, edge_cost, relaxation=Relaxation(mode=mode).replace(temperature=temperature))[0]


@_relaxed.defjvp
def _relaxed_jvp(
    mode: str, primals: tuple[Array, Array, Array], tangents: tuple[Array, Array, Array]
) -> tuple[tuple[Array, Array, Array], tuple[Array, Array, Array]]:
    """By hand: all that grows with the edges is outside of the loops, which are left with products with a vector."""
    (start_cost, edge_cost, temperature), (start_change, edge_change, warmer) = primals, tangents
    found, trail = kept(
        searched(start_cost, edge_cost, relaxation=Relaxation(mode=mode).replace(temperature=temperature))
    )
    (_, nodes, _), shares = found, trail.shares
    through, smooth = edge_cost + trail.ahead[:, None, :], Relaxation(mode="soft").replace(temperature=temperature)
    choice = Softmin(through, shares if mode == "soft" else soft.choose(through, smooth), temperature, warmer)

    def backward(change: Array, step: tuple[Array, Array]) -> tuple[Array, Array]:
        weights, own = step
        return own + jnp.sum(weights * change[None, :], axis=1), change

    begun, ahead = jax.lax.scan(
        backward, jnp.zeros_like(start_cost), (choice.shares, choice.value_change(edge_change)), reverse=True
    )
    first = Softmin(trail.total, soft.choose(trail.total, smooth), temperature, warmer)
    first_change, apart = start_change + begun, choice.share_change(edge_change + ahead[:, None, :])
    moved = nodes[:-1, :, None] * apart

    def forward(change: Array, step: tuple[Array, Array]) -> tuple[Array, Array]:
        taken, own = step
        following = own + jnp.sum(change[:, None] * taken, axis=0)
        return following, following

    node_change = first.share_change(first_change)
    _, others = jax.lax.scan(forward, node_change, (shares, jnp.sum(moved, axis=1)))
    node_changes = jnp.concatenate([node_change[None], others])
    return found, (
        first.value_change(first_change),
        node_changes,
        node_changes[:-1, :, None] * shares + moved,
    )


class Softmin:
    """Derivatives of the softmin of costs [.., n] and of its shares, with the temperature T by which it changes."""

    def __init__(self, cost: Array, shares: Array, temperature: Array, warmer: Array):
        self.shares, self.temperature, self.warmer = shares, temperature, warmer / temperature
        # From the least cost on: a price of thousands leaves no digits for the rest.
        beyond = cost - jnp.min(cost, axis=-1, keepdims=True)
        mean = jnp.sum(shares * beyond, axis=-1, keepdims=True)
        self.above = beyond - mean
        self.by_temperature = temperature * jnp.log(jnp.max(shares, axis=-1)) - mean[..., 0]  # T times it

    def value_change(self, change: Array) -> Array:
        """Of the softmin [..]. Args: change [.., n] of the costs."""
        return jnp.sum(self.shares * change, axis=-1) + self.by_temperature * self.warmer

    def share_change(self, change: Array) -> Array:
        """Of the shares [.., n]. Args: change [.., n] of the costs."""
        mean = jnp.sum(self.shares * change, axis=-1, keepdims=True)
        return self.shares * (self.above * self.warmer - (change - mean)) / self.temperature


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
