"""The decision tree of path selection: route, micro path or ego lane (Eq. 27, Fig. 5)."""

from typing import ClassVar

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import lean, soft
from urbanjax.types import POSITIVE, SHARE, SOFT, Decision, field, pytree, static
from urbanjax.vehicle.driving import Driving

ROUTE, MICRO, EGO = 0, 1, 2  # order of the three paths of Eq. 27


@pytree
class TSPSParams:
    """Thresholds of the tree. A `*_scale` is the margin that counts as clear when the tree is relaxed."""

    PINNED: ClassVar[dict[str, str]] = {
        "horizon": "safety: how long a path must be free of collisions",
        "confidence": "safety: how surely a path is free before it is begun",
        "margin": "safety: the clearance that a feasible path keeps",
        "standing_speed": "definition: of standing",
        "signal_distance": "safety: nobody is overtaken before a turn at a signal",
        "queue_distance": "safety: nobody is overtaken in the queue of a signal",
        "queue_start": "fact: how fast queues start",
        "yellow_*": "safety: when one stops at yellow",
        "line_passed": "definition: of the next stop line",
        "turn_reach": "definition: of a turn that belongs to a signal",
        "entered_share": "definition: of a lane beside",
        "side_front": "safety: the free space that entering a lane asks for",
        "side_rear": "safety: the free space that entering a lane asks for",
        "side_time": "safety: the free space that entering a lane asks for",
        "emergency_deceleration": "safety: when full braking is due",
        "*_scale": SOFT,
    }

    horizon: float = 6.0  # s, over which a path must be free of collisions
    margin: float = 0.35  # m, clearance that a feasible path keeps
    margin_scale: float = 0.5  # m
    patience: float = 0.3  # s, time constant of the filter on "the route is blocked" (hysteresis)
    # s, for which the micro path is feasible before it is begun
    confidence: float = field(default=0.5, metadata=POSITIVE)
    standing_speed: float = 0.3  # m/s, below which the vehicle stands
    stuck_time: float = 3.0  # s, after which a standing vehicle is stuck
    signal_distance: float = 30.0  # m, to the stop line, within which the turn beyond it counts
    # m, to the stop line, within which one who stands may be in its queue
    queue_distance: float = field(default=150.0, metadata=POSITIVE)
    # m/s, at which vehicles in a queue come to start after green, from the line backwards
    queue_start: float = field(default=4.0, metadata=POSITIVE)
    yellow_deceleration: float = 3.5  # m/s^2, beyond which one does not stop at yellow any more
    yellow_reaction: float = 0.3  # s
    line_passed: float = 1.0  # m behind the front bumper, up to which a stop line is still the next one
    turn_reach: float = 20.0  # m beyond a stop line, within which a turn belongs to its signal
    # of the ego lane's width, by which a lane's centre is beside the vehicle to be another
    entered_share: float = field(default=0.25, metadata=SHARE)
    side_rear: float = 3.0  # m, free space behind the rear bumper in the lane that is entered
    side_front: float = 2.0  # m, free space before the front bumper
    side_time: float = 1.5  # s, by which the rear space grows with the closing speed
    side_scale: float = 1.0  # m
    emergency_deceleration: float = 5.5  # m/s^2, needed in every lane before the tree gives up
    side_gates_stuck: bool = static(default=False)  # does rule 5 also gate rule 2
    stuck_needs_micro: bool = static(default=True)  # does rule 2 need a feasible micro path


@pytree
class Conditions:
    """The inputs of Fig. 5, as degrees in [0, 1]; all shapes []."""

    route_feasible: Array
    stuck: Array
    micro_feasible: Array
    turning_at_signal: Array  # near a signal and turning left or right
    side_occupied: Array  # a vehicle that moves beside, in the lane that the micro path enters
    return_occupied: Array  # a vehicle beside, in the route's lane, with the ego outside it
    stoppable: Array  # a stop in some lane needs no emergency braking


@pytree
class TSPSState:
    """What selection remembers."""

    stuck: Array  # [] s that the vehicle has stood without having to wait
    blocked: Array  # [] filtered degree to which the route is infeasible
    doubt: Array  # [] degree to which the micro path was infeasible lately, fading


@pytree
class Selection:
    """The outcome: weights over (route, micro, ego lane), and over the reasons."""

    path: Array  # [3]
    decision: Array  # [7], indexed by Decision
    emergency: Array  # [] degree of the emergency stop


def init(dtype: jnp.dtype) -> TSPSState:
    """Nothing remembered. Args: dtype, of its floats."""
    return TSPSState(*(jnp.zeros((), dtype) for _ in TSPSState.__dataclass_fields__))


def remember(
    state: TSPSState,
    driving: Driving,
    *,
    speed: Float[Array, ""],
    held: Float[Array, ""],
    route_free: Float[Array, ""],
    micro: Float[Array, ""],
) -> TSPSState:
    """The counters one step on: the time stuck rises while standing, stays while one has to wait, is cleared by moving.

    Args: state; driving, with TSPSParams; speed [] m/s; held [], degree to which a signal or somebody else has to be
    waited for; route_free, micro [], degrees to which those paths are feasible.
    """
    params, period = driving.params, driving.period
    moving = soft.above(speed, params.standing_speed, driving.relaxation, scale=params.standing_speed)
    stuck = soft.negate(moving) * (state.stuck + period * soft.negate(held))
    share = period / lean.maximum(params.patience, period)
    blocked = state.blocked + (soft.negate(route_free) - state.blocked) * share
    doubt = lean.maximum(soft.negate(micro), state.doubt - period / params.confidence)
    return TSPSState(stuck=stuck, blocked=blocked, doubt=lean.maximum(doubt, 0.0))


def standing(
    state: TSPSState, driving: Driving, *, queued: Float[Array, ""], distance: Float[Array, ""]
) -> Float[Array, ""]:
    """Degree to which the vehicle is stuck: it has stood for `stuck_time`, and for what a queue takes to start.

    A queue starts from its head, so that who stands farther from the line waits longer after green. Args: state;
    driving, with TSPSParams; queued [], degree of standing before a signal; distance [] m, to its stop line.
    """
    params = driving.params
    wave = queued * lean.maximum(distance, 0) / params.queue_start
    return soft.above(state.stuck - wave, params.stuck_time, driving.relaxation, scale=params.stuck_time / 4)


def decide(conditions: Conditions, params: TSPSParams, *, safest: Float[Array, "3"]) -> Selection:
    """The tree of Fig. 5 (Eq. 27) in its order; with degrees 0 and 1 exactly one outcome has weight 1.

    (1) route feasible -> route; (2) stuck -> micro; (3) micro infeasible -> route; (4) turning at a signal -> route;
    (5) side area occupied -> ego lane; (6) micro. Rule 3 keeps the ego lane instead while a vehicle beside blocks the
    way back to the route's lane. Where neither path is feasible and no lane lets the vehicle stop
    by normal braking, the outcome is an emergency stop along the least bad of the three. Args: conditions, of Fig. 5;
    safest [3], weights over the paths on the one of most clearance.
    """
    rest = jnp.ones_like(conditions.route_feasible)
    outcome = {}

    def take(reason: Decision, degree: Array) -> None:
        nonlocal rest
        outcome[reason] = soft.both(rest, degree)
        rest = soft.both(rest, soft.negate(degree))

    escape = conditions.stuck
    if params.stuck_needs_micro:
        escape = soft.both(escape, conditions.micro_feasible)
    if params.side_gates_stuck:
        escape = soft.both(escape, soft.negate(conditions.side_occupied))
    infeasible = soft.negate(conditions.micro_feasible)
    take(Decision.ROUTE_FEASIBLE, conditions.route_feasible)
    take(Decision.STUCK_ESCAPE, escape)
    take(Decision.EMERGENCY_STOP, soft.both(infeasible, soft.negate(conditions.stoppable)))
    take(Decision.MICRO_INFEASIBLE, infeasible)
    take(Decision.TURN_AT_SIGNAL, conditions.turning_at_signal)
    take(Decision.SIDE_OCCUPIED, conditions.side_occupied)
    outcome[Decision.OVERTAKE] = rest
    decision = jnp.stack([outcome[d] for d in Decision])
    micro = outcome[Decision.STUCK_ESCAPE] + outcome[Decision.OVERTAKE]
    # "Keep the lane" (rule 3) means the ego lane where the route's lane is occupied alongside.
    ego = outcome[Decision.SIDE_OCCUPIED] + soft.both(outcome[Decision.MICRO_INFEASIBLE], conditions.return_occupied)
    emergency = outcome[Decision.EMERGENCY_STOP]
    path = jnp.stack([1 - micro - ego - emergency, micro, ego]) + emergency * safest
    return Selection(path=path, decision=decision, emergency=emergency)
