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
from urbanjax.planning.lattice.layers import MACRO_TERMS, LatticeWeights
from urbanjax.planning.lattice.search import layered_search
from urbanjax.planning.previous import Previous
from urbanjax.planning.situation import Situation
from urbanjax.types import POSITIVE, SOFT, field, pytree, static
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.limits import curve_speed
from urbanjax.vehicle.profile import ProfileParams, free_flow

__all__ = ["MACRO_TERMS", "MacroParams", "MacroPlan", "layered_search", "offset_at", "plan", "profile_at"]


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
    window, progress, state, prediction = situation.window, situation.progress, situation.ego, situation.prediction
    vehicle, params, relaxation = driving.vehicle, driving.params, driving.relaxation
    weighing = driving.of(params.weights)
    spacing = layer_spacing(situation, params)
    distance = spacing * jnp.arange(params.n_layers + 1).astype(spacing.dtype)
    road = cross_sections(window, fine_stations(progress.station + distance, CORNER))
    layers = layers_of(road, CORNER)
    cap = curve_speed(layers.curvature, params.lateral_acceleration, cap=layers.limit)
    speed, time = free_flow(state.speed, cap, distance=distance, params=params.profile)
    layers = lattice.build(road, speed, time=time, nodes_per_lane=params.nodes_per_lane)
    follower = followers(state, driving.of(params.clearance), prediction=prediction)
    room = lattice.clearance(layers, driving.of(params.clearance), prediction=prediction, follower=follower)
    layers, room = lattice.centred(layers, params.weights, room=room)
    nodes, node_bad = lattice.node_terms(layers, weighing, room=room, previous=previous)
    ways = lattice.ways(layers, progress.offset, vehicle=vehicle)
    start, start_bad = lattice.start_terms(layers, weighing, ways=ways, offset=progress.offset)
    edges, edge_bad = lattice.edge_terms(layers, weighing, ways=ways)

    node_cost = functools.reduce(operator.add, nodes.values())
    start_cost = functools.reduce(operator.add, start.values()) + node_cost[0]
    edge_cost = functools.reduce(operator.add, edges.values()) + node_cost[1:, None, :]
    value, marginal, edge = layered_search(start_cost, edge_cost, relaxation=relaxation, scale=params.choice_scale)
    bad = jnp.sum(marginal * node_bad, axis=1)
    bad = bad.at[0].add(jnp.sum(marginal[0] * start_bad)).at[1:].add(jnp.sum(edge * edge_bad, axis=(1, 2)))
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
        follower=follower,
        start_station=progress.station,
        start_offset=progress.offset,
        start_speed=speed[0],
    )


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
