"""Macro planning: the cheapest way through the lattice of lanes ahead, exact, in hard and soft form (Eq. 13-15)."""

import functools
import operator
from typing import ClassVar

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import lean, safe
from urbanjax.planning.basis import interpolate, smooth
from urbanjax.planning.clearance import ClearanceParams, followers
from urbanjax.planning.cross_section import cross_sections
from urbanjax.planning.lattice import layers as lattice
from urbanjax.planning.lattice.edges import CORNER, fine_stations, layers_of
from urbanjax.planning.lattice.layers import MACRO_TERMS, Lattice, LatticeWeights
from urbanjax.planning.lattice.search import layered_search
from urbanjax.planning.previous import Previous
from urbanjax.planning.situation import Situation
from urbanjax.types import POSITIVE, SOFT, field, pytree, static
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.limits import curve_speed
from urbanjax.vehicle.profile import ProfileParams, free_flow

__all__ = ["MACRO_TERMS", "MacroParams", "MacroPlan", "costs", "layered_search", "offset_at", "plan", "profile_at"]


@pytree
class MacroParams:
    """The lattice and what its edges cost."""

    PINNED: ClassVar[dict[str, str]] = {"choice_scale": SOFT}

    horizon: float = field(default=8.0, metadata=POSITIVE)  # s, at the free-flow speed
    min_spacing: float = field(default=2.0, metadata=POSITIVE)  # m, between layers
    max_spacing: float = 12.0  # m
    lateral_acceleration: float = 2.5  # m/s^2, assumed in curves
    choice_scale: float = 0.25  # m of cost that count as clearly cheaper
    profile: ProfileParams = ProfileParams()
    weights: LatticeWeights = LatticeWeights()
    clearance: ClearanceParams = ClearanceParams(margin=2.0)
    n_layers: int = static(default=20)
    nodes_per_lane: int = static(default=5)


@pytree
class MacroPlan:
    """The plan through S layers of M nodes, in the route's Frenet frame, and what it assumes of time and speed."""

    station: Array  # [S] m along the route
    offset: Array  # [S] m, left positive
    time: Array  # [S] s from now
    speed: Array  # [S] m/s, at free flow
    node_offset: Array  # [S, M] m
    marginal: Array  # [S, M] weight of each node, one-hot in mode hard
    value: Array  # [] cost of the plan
    terms: Array  # [C] its parts by MACRO_TERMS; they sum to the value in mode hard
    node_clearance: Array  # [S, M] m
    clearance: Array  # [] m, smallest along the plan
    feasible: Array  # [] degree: no collision and nothing forbidden along the plan
    follower: Array  # [B] degree to which an object follows the ego, and so does not count
    start_station: Array  # [] m, where the plan begins: the ego's own
    start_offset: Array  # [] m
    start_speed: Array  # [] m/s


def plan(situation: Situation, driving: Driving, *, previous: Previous) -> MacroPlan:
    """The lateral plan over the lanes ahead that costs least (Eq. 13-15).

    Eq. 13 as printed rewards nearness to obstacles and signed curvature, and Eq. 15 minimises over single nodes; here
    obstacles are a barrier, curvature is absolute, and the minimum is over paths. Args: situation, of the step;
    driving, with MacroParams; previous, the plan of the step before.
    """
    params, progress, relaxation = driving.params, situation.progress, driving.relaxation
    found = costs(situation, driving, previous=previous)
    layers, room, nodes, start, edges = found.lattice, found.room, found.nodes, found.start, found.edges
    start_cost, edge_cost = found.summed()
    value, marginal, edge = layered_search(start_cost, edge_cost, relaxation=relaxation, scale=params.choice_scale)
    bad = jnp.sum(marginal * found.node_bad, axis=1)
    bad = bad.at[0].add(jnp.sum(marginal[0] * found.start_bad)).at[1:].add(jnp.sum(edge * found.edge_bad, axis=(1, 2)))
    paid = [
        {k: jnp.sum(v * w) for k, v in d.items()} for d, w in ((nodes, marginal), (start, marginal[0]), (edges, edge))
    ]
    return MacroPlan(
        station=layers.station,
        offset=jnp.sum(marginal * layers.offset, axis=1),
        time=layers.time,
        speed=layers.speed,
        node_offset=layers.offset,
        marginal=marginal,
        value=value,
        terms=jnp.stack([sum(part.get(name, 0) for part in paid) for name in MACRO_TERMS]),
        node_clearance=room,
        clearance=safe.minimum(jnp.sum(marginal * room, axis=1)),
        feasible=jnp.prod(1 - jnp.clip(bad, 0, 1)),
        follower=found.follower,
        start_station=progress.station,
        start_offset=progress.offset,
        start_speed=found.start_speed,
    )


@pytree
class LatticeCosts:
    """What each way through the lattice pays, by name of MACRO_TERMS; and what of it is barred."""

    lattice: Lattice
    room: Array  # [S, M] m, clearance of each node
    follower: Array  # [B] degree to which an object follows the ego, and so does not count
    start_speed: Array  # [] m/s
    nodes: dict[str, Array]  # [S, M] m, of each node
    start: dict[str, Array]  # [M] m, of the edges to the first layer
    edges: dict[str, Array]  # [S - 1, M, M] m
    node_bad: Array  # [S, M] degree to which a node is forbidden
    start_bad: Array  # [M]
    edge_bad: Array  # [S - 1, M, M]

    def summed(self) -> tuple[Array, Array]:
        """Cost [M] of reaching each node of the first layer, and [S - 1, M, M] of going on, from row to column."""
        nodes = functools.reduce(operator.add, self.nodes.values())
        start = functools.reduce(operator.add, self.start.values()) + nodes[0]
        return start, functools.reduce(operator.add, self.edges.values()) + nodes[1:, None, :]


def costs(situation: Situation, driving: Driving, *, previous: Previous) -> LatticeCosts:
    """The lattice ahead and what its nodes and edges cost (Eq. 13-14): all that the plan and its likelihood depend on.

    Args: situation, of the step; driving, with MacroParams; previous, the plan of the step before.
    """
    window, progress, state, prediction = situation.window, situation.progress, situation.ego, situation.prediction
    vehicle, params = driving.vehicle, driving.params
    weighing, clearing = driving.of(params.weights), driving.of(params.clearance)
    spacing = layer_spacing(situation, params)
    distance = spacing * jnp.arange(params.n_layers + 1).astype(spacing.dtype)
    road = cross_sections(window, fine_stations(progress.station + distance, CORNER))
    ahead = layers_of(road, CORNER)
    cap = curve_speed(ahead.curvature, params.lateral_acceleration, cap=ahead.limit)
    speed, time = free_flow(state.speed, cap, distance=distance, params=params.profile)
    layers = lattice.build(road, speed, time=time, nodes_per_lane=params.nodes_per_lane)
    follower = followers(state, clearing, prediction=prediction)
    room = lattice.clearance(layers, clearing, prediction=prediction, follower=follower)
    layers, room = lattice.centred(layers, params.weights, room=room)
    nodes, node_bad = lattice.node_terms(layers, weighing, room=room, previous=previous)
    ways = lattice.ways(layers, progress.offset, vehicle=vehicle)
    start, start_bad = lattice.start_terms(layers, weighing, ways=ways, offset=progress.offset)
    edges, edge_bad = lattice.edge_terms(layers, weighing, ways=ways)
    return LatticeCosts(layers, room, follower, speed[0], nodes, start, edges, node_bad, start_bad, edge_bad)


def layer_spacing(situation: Situation, params: MacroParams) -> Float[Array, ""]:
    """Distance between layers (m): the way covered within the horizon, from the present speed to the limit, shared.

    Args: situation, of the step.
    """
    window, progress, state = situation.window, situation.progress, situation.ego
    spacing = window.station[1] - window.station[0]
    limit = interpolate(progress.station[None], window.station[0], spacing, window.speed_limit)[0]
    change = limit - state.speed
    rate = jnp.where(change > 0, params.profile.acceleration, params.profile.deceleration)
    ramp = lean.minimum(jnp.abs(change) / rate, params.horizon)
    end = state.speed + jnp.sign(change) * rate * ramp
    way = (state.speed + end) / 2 * ramp + end * (params.horizon - ramp)
    room = lean.maximum(window.station[-1] - progress.station, params.min_spacing)
    return (
        lean.minimum(jnp.clip(way, params.min_spacing * params.n_layers, params.max_spacing * params.n_layers), room)
        / params.n_layers
    )


def offset_at(plan: MacroPlan, station: Float[Array, "n"]) -> tuple[Float[Array, "n"], ...]:
    """Lateral offset [n] (m) of the plan at any stations, with its first and second derivative by station.

    The uniform cubic B-spline over the plan's layers, from the ego's own offset on: the lattice path has corners.
    Args: plan; station [n] m, along the route.
    """
    values = jnp.concatenate([plan.start_offset[None], plan.offset])
    return smooth(station, plan.start_station, plan.station[0] - plan.start_station, values)


def profile_at(plan: MacroPlan, station: Float[Array, "n"]) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
    """Free-flow time [n] (s) and speed [n] (m/s) of the plan at any stations; past its end, at its last speed.

    Args: plan; station [n] m, along the route.
    """
    time = jnp.concatenate([jnp.zeros_like(plan.time[:1]), plan.time])
    speed = jnp.concatenate([plan.start_speed[None], plan.speed])
    spacing = plan.station[0] - plan.start_station
    both = interpolate(station, plan.start_station, spacing, jnp.stack([time, speed], axis=-1))
    beyond = lean.maximum(station - plan.station[-1], 0) / plan.speed[-1]
    return both[:, 0] + beyond, both[:, 1]
