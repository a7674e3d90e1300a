"""What the decision tree needs to know: free sides, room to stop, signals ahead."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.behavior.surroundings import Surroundings
from urbanjax.behavior.tree import TSPSParams
from urbanjax.numerics import lean, safe, soft
from urbanjax.planning.situation import Situation
from urbanjax.roadmap.corridor import Corridor
from urbanjax.roadmap.graph import Turn
from urbanjax.types import Signals, SignalState, pytree
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.params import VehicleParams


@pytree
class Body:
    """The ego vehicle along the route; all shapes []."""

    rear: Array  # m, station of the rear bumper
    front: Array  # m, station of the front bumper
    offset: Array  # m, lateral
    speed: Array  # m/s

    @property
    def centre(self) -> Array:
        """Station of the centre of the box, in metres."""
        return (self.rear + self.front) / 2


def body_of(situation: Situation, vehicle: VehicleParams) -> Body:
    """The ego's bumpers and centre along the route. Args: situation, of the step; vehicle."""
    start = situation.progress
    rear = start.station - vehicle.rear_overhang
    centre = start.offset + vehicle.centre_offset * jnp.sin(start.heading_error)
    return Body(rear=rear, front=rear + vehicle.length, offset=centre, speed=situation.ego.speed)


def beside(
    surroundings: Surroundings, driving: Driving, *, occupancy: Float[Array, "o"], body: Body
) -> Float[Array, ""]:
    """Degree to which some object of a lane stands in the side area: alongside, close ahead, or closing from behind.

    Args: surroundings [O]; driving, with TSPSParams; occupancy [O], degree of being in the lane that would be entered;
    body, of the ego.
    """
    params, relaxation = driving.params, driving.relaxation
    closing = lean.maximum(surroundings.speed - body.speed, 0)
    rear_gap = body.rear - (surroundings.station + surroundings.half_length)
    front_gap = (surroundings.station - surroundings.half_length) - body.front
    too_close_behind = soft.above(
        params.side_rear + params.side_time * closing - rear_gap, 0.0, relaxation, scale=params.side_scale
    )
    too_close_ahead = soft.above(params.side_front - front_gap, 0.0, relaxation, scale=params.side_scale)
    each = soft.both(occupancy, soft.both(too_close_behind, too_close_ahead))
    return soft.negate(jnp.prod(soft.negate(each)))


def entering(lane: Float[Array, ""], driving: Driving, *, body: Body, lane_width: Float[Array, ""]) -> Float[Array, ""]:
    """Degree to which a lane is another than the one the vehicle is in.

    Args: lane [] m, offset of its centre; driving, with TSPSParams; body, of the ego; lane_width [] m, of the ego lane.
    """
    params = driving.params
    away = safe.sqrt((lane - body.offset) ** 2 + 1e-6)
    return soft.above(away, params.entered_share * lane_width, driving.relaxation, scale=params.margin_scale)


def can_stop(
    surroundings: Surroundings, driving: Driving, *, occupancy: Float[Array, "o"], body: Body
) -> Float[Array, ""]:
    """Degree to which braking below `emergency_deceleration` avoids every object of a lane ahead.

    Args: surroundings [O]; driving, with TSPSParams; occupancy [O], degree of being in the lane; body, of the ego.
    """
    params, relaxation = driving.params, driving.relaxation
    gap = surroundings.station - surroundings.half_length - body.front
    ahead = soft.above(gap + 2 * surroundings.half_length, 0.0, relaxation, scale=1.0)
    front_speed = lean.maximum(surroundings.speed, 0)
    closing = lean.maximum(body.speed - front_speed, 0)
    needed = closing**2 / (2 * lean.maximum(gap, 0.5))
    worst = safe.maximum(occupancy * ahead * needed)
    return soft.above(params.emergency_deceleration - worst, 0.0, relaxation, scale=1.0)


@pytree
class SignalAhead:
    """The next stop line on the route."""

    exists: Array  # [] bool, there is one
    distance: Array  # [] m from the front bumper; 0 where there is none
    red: Array  # [] 0 or 1: red, or yellow with room to stop
    turning: Array  # [] 0 or 1: the route turns left or right beyond it


def signal_ahead(situation: Situation, body: Body, *, params: TSPSParams) -> SignalAhead:
    """The nearest stop line in front of the bumper, with the state of its signal. Not differentiable in the state.

    What is not known to be green or yellow is red; at yellow one goes on who would have to brake harder than
    `yellow_deceleration` (it exceeds that of a stop, so that who brakes for yellow keeps braking), but not who would
    come to the line only at red and can still stop before it by `emergency_deceleration`. Args: situation, of the step;
    body, of the ego.
    """
    window, signals = situation.window, situation.signals
    distance = window.stop_station - body.front
    ahead = window.has_stop & (distance > -params.line_passed)
    nearest = jnp.argmin(jnp.where(ahead, distance, jnp.inf))
    exists = ahead[nearest]
    shown = signals.shown(window.stop_signal[nearest])
    to_line = lean.maximum(distance[nearest], 0)
    room = lean.maximum(to_line - params.yellow_reaction * body.speed, 0)
    in_time = body.speed**2 <= 2 * params.yellow_deceleration * room
    late = to_line > body.speed * signals.lasts(window.stop_signal[nearest])
    stops = in_time | (late & (body.speed**2 <= 2 * params.emergency_deceleration * to_line))
    red = exists & ((shown == SignalState.RED) | ((shown == SignalState.YELLOW) & stops))
    beyond = (window.station > body.rear) & (window.station < window.stop_station[nearest] + params.turn_reach)
    turns = (window.turn == Turn.LEFT) | (window.turn == Turn.RIGHT)
    turning = jnp.any(beyond & turns) & exists
    dtype = distance.dtype
    return SignalAhead(
        exists=exists,
        distance=jnp.where(exists, distance[nearest], 0),
        red=red.astype(dtype),
        turning=turning.astype(dtype),
    )


def closed_line(
    road: Corridor, signals: Signals, *, front: Float[Array, ""]
) -> tuple[Float[Array, ""], Bool[Array, ""]]:
    """Station [] m of the next stop line whose signal is not green, and whether there is one (else it is infinite).

    What drivers without a rule for yellow stop at. Args: road, the lanes around the vehicle; signals; front [] m,
    station of its front bumper.
    """
    closed = road.has_stop & (signals.shown(road.stop_signal) != SignalState.GREEN) & (road.stop_station > front)
    return jnp.min(jnp.where(closed, road.stop_station, jnp.inf)), jnp.any(closed)


def near_signal(ahead: SignalAhead, driving: Driving, *, reach: float | Array) -> Float[Array, ""]:
    """Degree to which the next stop line is within `reach`. Args: ahead; driving, with TSPSParams; reach [m]."""
    near = soft.above(reach - ahead.distance, 0.0, driving.relaxation, scale=reach / 3)
    return jnp.where(ahead.exists, near, 0)
