"""Exact likelihood of a driven path under the soft dynamic programme of the macro lattice.

P(path) = exp((V - cost(path)) / T), with V the soft least cost over all paths. Length has weight 1, which fixes the
scale of all weights; T is free.
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int

from urbanjax.evaluation.recorded.demonstration import Demonstration
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning import macro
from urbanjax.planning.lattice.layers import MACRO_TERMS, LatticeWeights
from urbanjax.planning.lattice.search import layered_search
from urbanjax.planning.macro import LatticeCosts
from urbanjax.planning.previous import nothing
from urbanjax.roadmap.progress import progress
from urbanjax.types import pytree
from urbanjax.vehicle.driving import Driving

# Of these a cost is a multiple; `clearance` is none of the terms, and it also moves the nodes.
LINEAR = tuple(name for name in MACRO_TERMS if name != "length")
ELSEWHERE = 1e6  # m, price of a node beside the driven one, more than any path costs


@pytree
class DrivenPath:
    """What a driver did in the lattice: the nodes of S layers, and what each way pays at weights of 1."""

    costs: LatticeCosts  # at weights of 1
    node: Array  # [S] int32, nearest to the driver
    reached: Array  # [S] bool, layers that the record reaches
    barred: Array  # [] bool: the driven nodes collide, or break what no weight pays for


def driven_path(demonstration: Demonstration, driving: Driving) -> DrivenPath:
    """The lattice at a moment and the driver's way through it; nothing is remembered, so that transition is 0.

    Args: demonstration, one; driving, with MacroParams.
    """
    params = driving.params
    unit = params.weights.replace(**dict.fromkeys(LINEAR, 1.0))
    driving = driving.of(params.replace(weights=unit)).replace(vehicle=demonstration.vehicle)
    costs = macro.costs(demonstration.situation, driving, previous=nothing(params.n_layers))
    node, reached = nodes_of(demonstration, costs)
    layers = jnp.arange(node.shape[0])
    bad = jnp.where(reached, costs.node_bad[layers, node], 0) > 0.5
    steps = jnp.where(reached[1:], costs.edge_bad[layers[1:] - 1, node[:-1], node[1:]], 0) > 0.5
    barred = jnp.any(bad) | jnp.any(steps) | (reached[0] & (costs.start_bad[node[0]] > 0.5))
    return DrivenPath(costs, node, reached, barred)


def nodes_of(demonstration: Demonstration, costs: LatticeCosts) -> tuple[Int[Array, "s"], Bool[Array, "s"]]:
    """The node [S] of each layer that is nearest to the driver, and whether the record reaches the layer.

    Args: demonstration, one; costs, with the lattice.
    """
    window, vehicle = demonstration.situation.window, demonstration.vehicle
    towards = jnp.stack([jnp.cos(demonstration.heading), jnp.sin(demonstration.heading)], axis=-1)
    axle = demonstration.position - vehicle.centre_offset * towards
    there = jax.vmap(lambda p, h: progress(window, p, heading=h))(axle, demonstration.heading)
    here = demonstration.situation.progress
    station = jnp.where(demonstration.valid, there.station, -jnp.inf)
    station = jax.lax.cummax(jnp.concatenate([here.station[None], station]))
    offset = jnp.concatenate([here.offset[None], there.offset])
    at = jnp.interp(costs.lattice.station, station, offset)
    node = jnp.argmin(jnp.abs(costs.lattice.offset - at[:, None]), axis=1).astype(jnp.int32)
    return node, costs.lattice.station <= station[-1]


def weighed(costs: LatticeCosts, weights: LatticeWeights) -> tuple[Float[Array, "m"], Float[Array, "e m m"]]:
    """Cost of starts [M] and edges [S - 1, M, M] (m), each with the node it leads to, at some weights.

    Args: costs, at weights of 1; weights, by which those of LINEAR are multiplied.
    """

    def multiplied(parts: dict[str, Array]) -> dict[str, Array]:
        return {name: part * getattr(weights, name) if name in LINEAR else part for name, part in parts.items()}

    names = ("nodes", "start", "edges")
    return dataclasses.replace(costs, **{name: multiplied(getattr(costs, name)) for name in names}).summed()


def path_loss(
    start_cost: Float[Array, "m"],
    edge_cost: Float[Array, "e m m"],
    *,
    node: Int[Array, "s"],
    reached: Bool[Array, "s"],
    temperature: float | Float[Array, ""],
) -> Array:
    """-log p of the paths through these nodes [nat]; layers that are not reached are summed over, not guessed.

    The soft least cost over the paths that keep to the nodes, less that over all of them, over T. Args: start_cost [M]
    m; edge_cost [S-1, M, M] m; node [S], the driver's; reached [S], layers where it is known; temperature T [] m.
    """
    relaxation = Relaxation(1.0, mode="soft")
    others = jnp.arange(start_cost.shape[0])[None, :] != node[:, None]
    barrier = jnp.where(others & reached[:, None], ELSEWHERE, 0.0).astype(start_cost.dtype)
    along = layered_search(
        start_cost + barrier[0], edge_cost + barrier[1:, None, :], relaxation=relaxation, scale=temperature
    )
    whole = layered_search(start_cost, edge_cost, relaxation=relaxation, scale=temperature)
    return (along[0] - whole[0]) / temperature


def driven_path_loss(path: DrivenPath, weights: Any, *, temperature: float | Float[Array, ""]) -> Array:
    """-log p of what a driver did [nat], see `path_loss`. Args: path; weights, a LatticeWeights; temperature [] m."""
    start, edges = weighed(path.costs, weights)
    return path_loss(start, edges, node=path.node, reached=path.reached, temperature=temperature)
