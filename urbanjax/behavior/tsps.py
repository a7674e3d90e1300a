"""Task-specific path selection: the three candidate paths, how they stand, and the one to drive (Eq. 25-27)."""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.behavior import caps
from urbanjax.behavior.candidates import connect, room_along
from urbanjax.behavior.lanes import nearest_lane, terminal
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
from urbanjax.behavior.tree import ROUTE, Conditions, Selection, TSPSState, decide, remember
from urbanjax.numerics import soft
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning.micro import MicroPlan
from urbanjax.roadmap.corridor import Corridor, Progress, Sample, sample, sample_one
from urbanjax.types import Observation, Path, Prediction, VehicleState, pytree
from urbanjax.vehicle.params import VehicleParams
from urbanjax.vehicle.profile import free_flow


@pytree
class SelectState:
    """What path selection remembers."""

    tree: TSPSState
    ego_lane: Array  # [Q] weights


@pytree
class View:
    """What one step's behaviour looks at."""

    road: Sample  # [K], on the grid that the paths share
    here: Sample  # [], at the front bumper
    surroundings: Surroundings
    body: Body
    signal: SignalAhead


@pytree
class LaneWeights:
    """Weights over the lanes across; all shapes [Q]."""

    route: Array
    ego: Array  # nearest to the vehicle, Eq. 26
    micro: Array  # nearest to the micro path's terminal point


@pytree
class Candidate:
    """One of the three paths of Eq. 27, or all of them stacked along the first axis."""

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
    situation: Conditions
    clearance: Array  # [3] m, smallest clearance of (route, micro, ego lane)
    scene: View


def init(start: Progress, corridor: Corridor) -> SelectState:
    """Nothing remembered; the ego lane is the route's."""
    weights = jnp.zeros_like(corridor.lane_offset[0]).at[corridor.route_lane].set(1)
    zero = jnp.zeros_like(start.offset)
    return SelectState(tree=TSPSState(stuck=zero, blocked=zero), ego_lane=weights)


def select(
    window: Corridor,
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
    otherwise a slow leader would never make the route infeasible. Args: follower [B], degree to which a predicted
    object follows the ego, and so does not count.
    """
    body, station = body_of(start, ego, vehicle), micro.path.station
    scene = View(
        road=sample(window, station),
        here=sample_one(window, body.front),
        surroundings=relate(observation.objects, window),
        body=body,
        signal=signal_ahead(window, observation.signals, body),
    )
    lanes = find_lanes(scene, micro.path, window.route_lane, state.ego_lane, params, relaxation)

    def candidate(lane: Float[Array, "q"]) -> Candidate:
        path = connect(scene.road, start, ego, station, scene.road.lane_offset @ lane, params.connect)
        cap = caps.along(path, scene.road.speed_limit, params.caps)
        speed, time = free_flow(ego.speed, cap, distance=station - station[0], params=params.profile)
        horizon = params.tsps.horizon
        room = room_along(path, speed, time, horizon, prediction, follower, vehicle, params.clearance, relaxation)
        return Candidate(path=path, cap=cap, time=time, clearance=room)

    cap = caps.along(micro.path, scene.road.speed_limit, params.caps)
    over = Candidate(path=micro.path, cap=cap, time=micro.time, clearance=micro.clearance)
    others = jax.vmap(candidate)(jnp.stack([lanes.route, lanes.ego]))
    candidates = jax.tree.map(lambda a, b: jnp.stack([a[0], b, a[1]]), others, over)
    memory, situation = assess(
        scene, lanes, candidates.clearance[ROUTE], micro.feasible, state.tree, vehicle, params, relaxation
    )
    selection = decide(situation, params.tsps)
    chosen, target = soft.mixed(selection.path, (candidates, jnp.stack([lanes.route, lanes.micro, lanes.ego])))
    along_ego = scene.road.lane_offset @ lanes.ego
    choice = Choice(
        path=chosen.path,
        cap=chosen.cap,
        time=chosen.time,
        terminal=terminal(chosen.path.offset, along_ego, params.connect.terminal_scale, relaxation),
        ego_lane=lanes.ego,
        target_lane=target,
        selection=selection,
        situation=situation,
        clearance=candidates.clearance,
        scene=scene,
    )
    return SelectState(tree=memory, ego_lane=lanes.ego), choice


def find_lanes(
    scene: View,
    micro: Path,
    route_lane: int,
    previous: Float[Array, "q"],
    params: BehaviorParams,
    relaxation: Relaxation,
) -> LaneWeights:
    """The route's lane, the ego lane and the lane in which the micro path has its terminal point."""
    ego = nearest_lane(scene.here, scene.body.offset, previous, params.lanes, relaxation)
    end = terminal(micro.offset, scene.road.lane_offset @ ego, params.connect.terminal_scale, relaxation)
    exists = end @ scene.road.has_lane.astype(end.dtype) > 0.5
    there = scene.here.replace(lane_offset=end @ scene.road.lane_offset, has_lane=exists)
    nowhere = jnp.zeros_like(previous)
    return LaneWeights(
        route=nowhere.at[route_lane].set(1),
        ego=ego,
        micro=nearest_lane(there, end @ micro.offset, nowhere, params.lanes, relaxation),
    )


def assess(
    scene: View,
    lanes: LaneWeights,
    route_clearance: Float[Array, ""],
    micro_feasible: Float[Array, ""],
    state: TSPSState,
    vehicle: VehicleParams,
    params: BehaviorParams,
    relaxation: Relaxation,
) -> tuple[TSPSState, Conditions]:
    """The inputs of the decision tree, as degrees, and its counters one step on."""
    tree, here, body, around = params.tsps, scene.here, scene.body, scene.surroundings

    def occupied(lane: Float[Array, "q"]) -> Float[Array, "o"]:
        return in_lane(around, around.lane_offset @ lane, vehicle.width / 2, params.occupancy, relaxation)

    def blocked_beside(lane: Float[Array, "q"], occupancy: Float[Array, "o"]) -> Float[Array, ""]:
        enters = entering(here.lane_offset @ lane, body, here.lane_width @ lanes.ego / 4, tree, relaxation)
        return soft.both(enters, beside(around, occupancy, body, tree, relaxation))

    in_route, in_ego, in_micro = occupied(lanes.route), occupied(lanes.ego), occupied(lanes.micro)
    return_occupied = blocked_beside(lanes.route, in_route)
    clear = soft.above(route_clearance, tree.margin, relaxation, scale=tree.margin_scale)
    near = near_signal(scene.signal, tree, relaxation)
    route_free = soft.both(clear, soft.negate(return_occupied))
    memory = remember(state, body.speed, soft.both(near, scene.signal.red), route_free, tree, relaxation)
    situation = Conditions(
        route_feasible=soft.above(0.5 - memory.blocked, 0.0, relaxation, scale=0.5),
        stuck=soft.above(memory.stuck, tree.stuck_steps, relaxation, scale=tree.stuck_steps / 4),
        micro_feasible=micro_feasible,
        turning_at_signal=soft.both(near, scene.signal.turning),
        side_occupied=blocked_beside(lanes.micro, in_micro),
        return_occupied=return_occupied,
        stoppable=soft.either(
            can_stop(around, in_route, body, tree, relaxation),
            can_stop(around, in_ego, body, tree, relaxation),
        ),
    )
    return memory, situation
