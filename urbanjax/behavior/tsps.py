"""Task-specific path selection: the three candidate paths, how they stand, and the one to drive (Eq. 25-27)."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.behavior import caps
from urbanjax.behavior.candidates import connect, mix, room_along
from urbanjax.behavior.lanes import lane_profile, nearest_lane, terminal
from urbanjax.behavior.params import BehaviorParams
from urbanjax.behavior.situation import (
    Body,
    SignalAhead,
    beside,
    body_of,
    can_stop,
    entering,
    near_signal,
    signal_ahead,
)
from urbanjax.behavior.surroundings import Surroundings, in_lane, relate
from urbanjax.behavior.tree import EGO, MICRO, ROUTE, Selection, Situation, TSPSState, decide, remember
from urbanjax.numerics import soft
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning.micro import MicroPlan
from urbanjax.roadmap.extended import ExtendedGraph, Progress, sample, sample_one
from urbanjax.types import Observation, Path, Prediction, VehicleState, pytree
from urbanjax.vehicle.params import VehicleParams
from urbanjax.vehicle.profile import free_flow


@pytree
class SelectState:
    """What path selection remembers."""

    tree: TSPSState
    ego_lane: Array  # [Q] weights


@pytree
class Lanes:
    """Weights over the lanes across; all shapes [Q]."""

    route: Array
    ego: Array  # nearest to the vehicle, Eq. 26
    micro: Array  # nearest to the micro path's terminal point


@pytree
class Candidate:
    """One of the three paths of Eq. 27."""

    path: Path
    cap: Array  # [K] m/s, speed limit and curves
    time: Array  # [K] s, of passing each point at free-flow speed
    clearance: Array  # [] m, smallest over the horizon at free-flow speed


@pytree
class Choice:
    """The path to drive and all that speed planning needs to know of the choice."""

    path: Path
    cap: Array  # [K] m/s, along the path
    time: Array  # [K] s, of passing each point of it at free-flow speed
    terminal: Array  # [K] weights over the path's points on its terminal point
    ego_lane: Array  # [Q] weights, Eq. 26
    target_lane: Array  # [Q] weights, the lane that the path leads to
    selection: Selection
    situation: Situation
    clearance: Array  # [3] m, smallest clearance of (route, micro, ego lane)
    surroundings: Surroundings
    body: Body
    signal: SignalAhead


def init(start: Progress, extended: ExtendedGraph) -> SelectState:
    """Nothing remembered; the ego lane is the route's."""
    weights = jnp.zeros_like(extended.lane_offset[0]).at[extended.route_lane].set(1)
    zero = jnp.zeros_like(start.offset)
    return SelectState(tree=TSPSState(stuck=zero, blocked=zero), ego_lane=weights)


def select(
    window: ExtendedGraph,
    start: Progress,
    ego: VehicleState,
    observation: Observation,
    prediction: Prediction,
    follower: Float[Array, "b"],
    micro: MicroPlan,
    state: SelectState,
    vehicle: VehicleParams,
    params: BehaviorParams,
    relaxation: Relaxation,
) -> tuple[SelectState, Choice]:
    """The path that task-specific path selection chooses (Eq. 27), and the state one step on.

    Route and ego-lane paths start at the present pose and are judged at free-flow speed without car following:
    otherwise a slow leader would never make the route infeasible.
    """
    body = body_of(start, ego, vehicle)
    surroundings = relate(observation.objects, window)
    signal = signal_ahead(window, observation.signals, body)
    station = micro.path.station
    limit = sample(window, station).speed_limit
    lanes = find_lanes(window, body, micro.path, state.ego_lane, params, relaxation)

    def candidate(lane: Float[Array, "q"]) -> Candidate:
        path = connect(window, start, ego, station, lane_profile(window, station, lane), params.connect)
        cap = caps.along(path, limit, params.caps)
        speed, time = free_flow(ego.speed, cap, station - station[0], params.profile)
        horizon = params.tsps.horizon
        room = room_along(path, speed, time, horizon, prediction, follower, vehicle, params.clearance, relaxation)
        return Candidate(path=path, cap=cap, time=time, clearance=room)

    micro_cap = caps.along(micro.path, limit, params.caps)
    candidates = {
        ROUTE: candidate(lanes.route),
        MICRO: Candidate(path=micro.path, cap=micro_cap, time=micro.time, clearance=micro.clearance),
        EGO: candidate(lanes.ego),
    }
    memory, situation = assess(
        window,
        ego,
        body,
        surroundings,
        signal,
        lanes,
        candidates[ROUTE].clearance,
        micro,
        state.tree,
        vehicle,
        params,
        relaxation,
    )
    selection = decide(situation, params.tsps)
    route, over, keep = selection.path
    ordered = [candidates[i] for i in range(3)]
    path = mix([c.path for c in ordered], selection.path)
    choice = Choice(
        path=path,
        cap=selection.path @ jnp.stack([c.cap for c in ordered]),
        time=selection.path @ jnp.stack([c.time for c in ordered]),
        terminal=terminal(
            path.offset, lane_profile(window, station, lanes.ego), params.connect.terminal_scale, relaxation
        ),
        ego_lane=lanes.ego,
        target_lane=route * lanes.route + over * lanes.micro + keep * lanes.ego,
        selection=selection,
        situation=situation,
        clearance=jnp.stack([c.clearance for c in ordered]),
        surroundings=surroundings,
        body=body,
        signal=signal,
    )
    return SelectState(tree=memory, ego_lane=lanes.ego), choice


def find_lanes(
    window: ExtendedGraph,
    body: Body,
    micro: Path,
    previous: Float[Array, "q"],
    params: BehaviorParams,
    relaxation: Relaxation,
) -> Lanes:
    """The route's lane, the ego lane and the lane in which the micro path has its terminal point."""
    weights = jnp.zeros_like(previous).at[window.route_lane].set(1)
    ego = nearest_lane(sample_one(window, body.front), body.offset, previous, params.lanes, relaxation)
    along = lane_profile(window, micro.station, ego)
    end = terminal(micro.offset, along, params.connect.terminal_scale, relaxation)
    there = sample_one(window, end @ micro.station)
    nowhere = jnp.zeros_like(previous)
    return Lanes(
        route=weights,
        ego=ego,
        micro=nearest_lane(there, end @ micro.offset, nowhere, params.lanes, relaxation),
    )


def assess(
    window: ExtendedGraph,
    ego: VehicleState,
    body: Body,
    surroundings: Surroundings,
    signal: SignalAhead,
    lanes: Lanes,
    route_clearance: Float[Array, ""],
    micro: MicroPlan,
    state: TSPSState,
    vehicle: VehicleParams,
    params: BehaviorParams,
    relaxation: Relaxation,
) -> tuple[TSPSState, Situation]:
    """The inputs of the decision tree, as degrees, and its counters one step on."""
    tree, here = params.tsps, sample_one(window, body.front)

    def occupied(lane: Float[Array, "q"]) -> Float[Array, "o"]:
        centre = lane_profile(window, surroundings.station, lane)
        return in_lane(surroundings, centre, vehicle.width / 2, params.occupancy, relaxation)

    def blocked_beside(lane: Float[Array, "q"], occupancy: Float[Array, "o"]) -> Float[Array, ""]:
        enters = entering(here.lane_offset @ lane, body, here.lane_width @ lanes.ego / 4, tree, relaxation)
        return soft.both(enters, beside(surroundings, occupancy, body, tree, relaxation))

    in_route, in_ego, in_micro = occupied(lanes.route), occupied(lanes.ego), occupied(lanes.micro)
    return_occupied = blocked_beside(lanes.route, in_route)
    clear = soft.above(route_clearance, tree.margin, relaxation, scale=tree.margin_scale)
    near = near_signal(signal, tree, relaxation)
    route_free = soft.both(clear, soft.negate(return_occupied))
    memory = remember(state, ego.speed, soft.both(near, signal.red), route_free, tree, relaxation)
    situation = Situation(
        route_feasible=soft.above(0.5 - memory.blocked, 0.0, relaxation, scale=0.5),
        stuck=soft.above(memory.stuck, tree.stuck_steps, relaxation, scale=tree.stuck_steps / 4),
        micro_feasible=micro.feasible,
        turning_at_signal=soft.both(near, signal.turning),
        side_occupied=blocked_beside(lanes.micro, in_micro),
        return_occupied=return_occupied,
        stoppable=soft.either(
            can_stop(surroundings, in_route, body, tree, relaxation),
            can_stop(surroundings, in_ego, body, tree, relaxation),
        ),
    )
    return memory, situation
