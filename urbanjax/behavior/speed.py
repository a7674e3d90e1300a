"""The reference speed: geometry-aware velocity planning applied to the chosen path, under all its caps."""

from jax import Array
from jaxtyping import Float

from urbanjax.behavior import caps, gvp, right_of_way
from urbanjax.behavior.gvp import LaneSpeeds
from urbanjax.behavior.lanes import route_lane
from urbanjax.behavior.surroundings import in_lane, in_path, moving
from urbanjax.behavior.tsps import Choice
from urbanjax.numerics import lean, safe, soft
from urbanjax.planning.basis import interpolate
from urbanjax.types import pytree
from urbanjax.vehicle.driving import Driving


@pytree
class SpeedPlan:
    """The reference speed and its parts."""

    reference: Array  # [] m/s
    lanes: LaneSpeeds
    cap: Array  # [] m/s, of speed limit, curves, stop line and right of way
    clamp: Array  # [] m/s, of the time-to-collision clamp
    emergency: Array  # [] degree to which it brakes in full


def plan(choice: Choice, driving: Driving) -> SpeedPlan:
    """v_ref of Eq. 29 in m/s, below speed limit, curve speed, stop lines and others' right of way, and the clamp.

    Unlike in Eq. 28, one who stands and whom the path clears where it reaches its rear is no leader of a lane. Args:
    choice, of the path; driving, with BehaviorParams.
    """
    params, view, path, terminal = driving.params, choice.view, choice.path, choice.terminal
    around, body = view.surroundings, view.body
    telling = driving.of(params.occupancy)
    cap = caps.now(path, params.caps, cap=choice.cap, signal=view.signal, speed=body.speed)
    cap = right_of_way.speed(choice.way, driving, speed=body.speed, cap=cap)
    rear = around.station - around.half_length
    moves = moving(around, telling)
    on_path = interpolate(rear, path.station[0], path.station[1] - path.station[0], path.offset)
    hinders = in_path(around, telling, offset=on_path, moves=moves)
    # Between vehicles that stand in two lanes the path may be free while both lanes are blocked.
    counts = soft.either(hinders, moves)

    def behind(weights: Float[Array, "q"], lead: Float[Array, "o"]) -> Float[Array, ""]:
        lane = around.lane_offset @ weights
        occupancy = soft.both(in_lane(around, telling, lane=lane), counts)
        return gvp.following_speed(around, driving, occupancy=occupancy, body=body, lead=lead, cap=cap)

    def lane_speed(weights: Float[Array, "q"], front: Array, time: float | Array) -> Float[Array, ""]:
        return behind(weights, rear + time * around.speed - front)

    def distances(offset: Float[Array, ""], lanes: Float[Array, "q"]) -> tuple[Array, Array]:
        to_target, to_ego = (offset - lanes @ weights for weights in (choice.target_lane, choice.ego_lane))
        return safe.sqrt(to_target**2 + 1e-6), safe.sqrt(to_ego**2 + 1e-6)

    arrival = terminal @ path.station + body.front - path.station[0]
    lanes = gvp.plan_speed(
        terminal=distances(terminal @ path.offset, terminal @ view.road.lane_offset),
        centre=distances(body.offset, view.here.lane_offset),
        v_target=lane_speed(choice.target_lane, arrival, terminal @ choice.time),
        v_ego=lane_speed(choice.ego_lane, body.front, 0.0),
        params=params.gvp,
    )
    clamp = gvp.clamp(around, driving, in_path=hinders, front=body.front)
    # Where the ego's lane ends it falls in behind those who are ahead by half a length in the route's.
    zipper = behind(route_lane(choice.ego_lane), around.station - body.centre)
    merging = cap - choice.merges * lean.maximum(cap - zipper, 0.0)
    passing = gvp.passing_speed(around, driving, offset=on_path, moves=moves, body=body, cap=cap)
    reference = lean.minimum(lanes.reference, lean.minimum(merging, passing))
    reference = lean.minimum(reference, clamp) if params.gvp.ttc_clamp else reference
    emergency = soft.either(choice.selection.emergency, right_of_way.urgent(choice.way, driving))
    return SpeedPlan(reference=reference, lanes=lanes, cap=cap, clamp=clamp, emergency=emergency)
