"""Task-specific path selection: the three candidate paths, how they stand, and the one to drive (Eq. 25-27)."""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.behavior import caps, right_of_way
from urbanjax.behavior.candidates import connect, room_along
from urbanjax.behavior.lanes import nearest_lane, route_lane, terminal
from urbanjax.behavior.right_of_way import GiveWay
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
from urbanjax.behavior.surroundings import Surroundings, in_lane, moving, relate
from urbanjax.behavior.tree import ROUTE, Conditions, Selection, TSPSState, decide, remember, standing
from urbanjax.behavior.tree import init as nothing
from urbanjax.numerics import safe, soft
from urbanjax.planning.plan import Plan
from urbanjax.planning.situation import Situation
from urbanjax.roadmap.corridor import Corridor
from urbanjax.roadmap.progress import Progress, Sample, sample
from urbanjax.types import Path, pytree
from urbanjax.vehicle.driving import Driving
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
    clearance: Array  # [] m, smallest over the horizon at free-flow speed, but for waiting


@pytree
class Feasible:
    """What the paths allow; all shapes []."""

    route_clearance: Array  # m
    micro: Array  # degree to which the micro path is feasible
    waits: Array  # degree to which the ego gives way to somebody


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
    conditions: Conditions
    clearance: Array  # [3] m, smallest clearance of (route, micro, ego lane)
    way: GiveWay
    merges: Array  # [] degree to which the ego has to get into the route's lane, since its own ends
    view: View


def init(start: Progress, corridor: Corridor) -> SelectState:
    """Nothing remembered; the ego lane is the route's. Args: start, of the ego; corridor, along the route."""
    return SelectState(tree=nothing(start.offset.dtype), ego_lane=route_lane(corridor.lane_offset[0]))


def select(situation: Situation, driving: Driving, *, plan: Plan, state: SelectState) -> tuple[SelectState, Choice]:
    """The path that task-specific path selection chooses (Eq. 27), and the state one step on.

    Route and ego-lane paths start at the present pose and are judged at free-flow speed without car following:
    otherwise a slow leader would never make the route infeasible. Args: situation, of the step; driving, with
    BehaviorParams; plan, the motion plan; state, what is remembered.
    """
    params, relaxation, micro = driving.params, driving.relaxation, plan.micro
    view = look(situation, driving, path=micro.path)
    lanes = find_lanes(view, driving, micro=micro.path, previous=state.ego_lane)
    candidates, way = compare(situation, driving, plan=plan, view=view, lanes=lanes)
    feasible = Feasible(candidates.clearance[ROUTE], micro.feasible, way.waits)
    memory, conditions = assess(view, driving, lanes=lanes, feasible=feasible, state=state.tree)
    safest = soft.choose(-candidates.clearance, relaxation, scale=params.tsps.margin_scale)
    selection = decide(conditions, params.tsps, safest=safest)
    chosen, target = soft.mixed(selection.path, (candidates, jnp.stack([lanes.route, lanes.micro, lanes.ego])))
    along_ego, scale = view.road.lane_offset @ lanes.ego, params.connect.terminal_scale
    choice = Choice(
        path=chosen.path,
        cap=chosen.cap,
        time=chosen.time,
        terminal=terminal(chosen.path.offset, along_ego, scale=scale, relaxation=relaxation),
        ego_lane=lanes.ego,
        target_lane=target,
        selection=selection,
        conditions=conditions,
        clearance=candidates.clearance,
        way=way,
        merges=has_to_merge(view, driving, lanes=lanes),
        view=view,
    )
    return SelectState(tree=memory, ego_lane=lanes.ego), choice


def look(situation: Situation, driving: Driving, *, path: Path) -> View:
    """What behaviour looks at. Args: situation, of the step; driving, with BehaviorParams; path, the micro plan's."""
    body = body_of(situation, driving.vehicle)
    return View(
        road=sample(situation.window, path.station),
        here=sample(situation.window, body.front),
        surroundings=relate(situation.objects, situation.window),
        body=body,
        signal=signal_ahead(situation, body, params=driving.params.tsps),
    )


def compare(
    situation: Situation, driving: Driving, *, plan: Plan, view: View, lanes: LaneWeights
) -> tuple[Candidate, GiveWay]:
    """The three paths of Eq. 27, stacked, each with its caps, its times and its clearance; and for whom the ego waits.

    Args: situation, of the step; driving, with BehaviorParams; plan, the motion plan; view; lanes, of the paths.
    """
    params, micro, station, road = driving.params, plan.micro, plan.micro.path.station, view.road
    distance, profile = station - station[0], params.profile
    # One place of the path farther, since between two of them nobody knows where the road ends.
    reach = view.body.front - station[0] + params.caps.stop_margin + station[1] - station[0]

    def capped(path: Path) -> Array:
        cap = caps.along(path, params.caps, speed_limit=road.speed_limit)
        return cap * caps.open_road(path, driving.of(params.caps), road=road, reach=reach)

    def join(lane: Float[Array, "q"]) -> tuple[Path, Array]:
        path = connect(situation, params.connect, road=road, station=station, lane=road.lane_offset @ lane)
        return path, capped(path)

    paths, cap = jax.vmap(join)(jnp.stack([lanes.route, lanes.ego]))
    _, time = free_flow(situation.ego.speed, cap[0], distance=distance, params=profile)
    giving = driving.of(params.right_of_way)
    way = right_of_way.give_way(situation, giving, body=view.body, station=station, time=time)
    goes = right_of_way.goes_on(way, giving, distance=distance)

    def judge(path: Path, cap: Array) -> Candidate:
        _, time = free_flow(situation.ego.speed, cap * goes, distance=distance, params=profile)
        room = room_along(
            path,
            driving.of(params.clearance),
            time=time,
            horizon=params.tsps.horizon,
            prediction=situation.prediction,
            follower=plan.macro.follower,
        )
        return Candidate(path=path, cap=cap, time=time, clearance=room)

    others = jax.vmap(judge)(paths, cap)
    over = Candidate(
        path=micro.path,
        cap=capped(micro.path),
        time=micro.time,
        clearance=micro.clearance,
    )
    return jax.tree.map(lambda a, b: jnp.stack([a[0], b, a[1]]), others, over), way


def find_lanes(view: View, driving: Driving, *, micro: Path, previous: Float[Array, "q"]) -> LaneWeights:
    """The route's lane, the ego lane and the lane in which the micro path has its terminal point.

    Args: view; driving, with BehaviorParams; micro, the micro path; previous [Q], weights of the ego lane a step
    earlier.
    """
    params, road, telling = driving.params, view.road, driving.of(driving.params.lanes)
    ego = nearest_lane(view.here, telling, offset=view.body.offset, previous=previous)
    end = terminal(
        micro.offset, road.lane_offset @ ego, scale=params.connect.terminal_scale, relaxation=driving.relaxation
    )
    there = view.here.replace(lane_offset=end @ road.lane_offset, has_lane=end @ road.has_lane.astype(end.dtype))
    nowhere = jnp.zeros_like(previous)
    return LaneWeights(
        route=route_lane(previous),
        ego=ego,
        micro=nearest_lane(there, telling, offset=end @ micro.offset, previous=nowhere),
    )


def has_to_merge(view: View, driving: Driving, *, lanes: LaneWeights) -> Float[Array, ""]:
    """Degree to which the lane that the ego is in ends ahead, and is not the route's.

    Args: view; driving, with BehaviorParams; lanes, of the paths.
    """
    deciding, here = driving.of(driving.params.tsps), view.here
    ends = 1 - jnp.prod(view.road.has_lane.astype(lanes.ego.dtype) @ lanes.ego)
    away = entering(here.lane_offset @ lanes.route, deciding, body=view.body, lane_width=here.lane_width @ lanes.ego)
    return soft.both(ends, away)


def assess(
    view: View,
    driving: Driving,
    *,
    lanes: LaneWeights,
    feasible: Feasible,
    state: TSPSState,
) -> tuple[TSPSState, Conditions]:
    """The inputs of the decision tree, as degrees, and its counters one step on.

    Args: view; driving, with BehaviorParams; lanes, of the paths; feasible, what the paths allow; state, the counters.
    """
    params, relaxation = driving.params, driving.relaxation
    tree, here, body, around = params.tsps, view.here, view.body, view.surroundings
    deciding, telling = driving.of(tree), driving.of(params.occupancy)

    def occupied(lane: Float[Array, "q"]) -> Float[Array, "o"]:
        return in_lane(around, telling, lane=around.lane_offset @ lane)

    def blocked_beside(lane: Float[Array, "q"], occupancy: Float[Array, "o"]) -> Float[Array, ""]:
        enters = entering(here.lane_offset @ lane, deciding, body=body, lane_width=here.lane_width @ lanes.ego)
        return soft.both(enters, beside(around, deciding, occupancy=occupancy, body=body))

    in_route, in_ego, in_micro = occupied(lanes.route), occupied(lanes.ego), occupied(lanes.micro)
    # One that stands closes no gap: the micro path, where it is feasible, has room beside it.
    in_micro = soft.both(in_micro, moving(around, telling))
    return_occupied = blocked_beside(lanes.route, in_route)
    clear = soft.above(feasible.route_clearance, tree.margin, relaxation, scale=tree.margin_scale)
    near = near_signal(view.signal, deciding, reach=tree.signal_distance)
    queued = near_signal(view.signal, deciding, reach=tree.queue_distance)
    route_free, red = soft.both(clear, soft.negate(return_occupied)), soft.both(queued, view.signal.red)
    held = soft.either(red, feasible.waits)
    micro = feasible.micro
    memory = remember(state, deciding, speed=body.speed, held=held, route_free=route_free, micro=micro)
    # A path that is feasible every other moment is not begun; one that is under way goes on while it can.
    aside = safe.sqrt((body.offset - here.lane_offset @ lanes.ego) ** 2 + 1e-6)
    begun = soft.above(aside, tree.margin, relaxation, scale=tree.margin_scale)
    doubt = soft.both(soft.above(state.doubt, 0.0, relaxation, scale=0.5), soft.negate(begun))
    micro = soft.both(micro, soft.negate(doubt))
    conditions = Conditions(
        # Of two halves: the filter says what holds more often than not.
        route_feasible=soft.above(0.5 - memory.blocked, 0.0, relaxation, scale=0.5),
        stuck=standing(memory, deciding, queued=queued, distance=view.signal.distance),
        micro_feasible=micro,
        turning_at_signal=soft.both(near, view.signal.turning),
        side_occupied=blocked_beside(lanes.micro, in_micro),
        return_occupied=return_occupied,
        stoppable=soft.either(
            can_stop(around, deciding, occupancy=in_route, body=body),
            can_stop(around, deciding, occupancy=in_ego, body=body),
        ),
    )
    return memory, conditions
