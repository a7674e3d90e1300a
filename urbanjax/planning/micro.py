"""Micro planning: the candidate that costs least and breaks no limit (Eq. 22-24)."""

from typing import ClassVar

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import lean, polynomial, safe, soft
from urbanjax.numerics.kept import kept, recomputed
from urbanjax.planning import costs
from urbanjax.planning.clearance import ClearanceParams, Passage
from urbanjax.planning.learned import LearnedCost, context_of
from urbanjax.planning.nearest import nearest
from urbanjax.planning.previous import Previous, profile
from urbanjax.planning.primitives import Fan
from urbanjax.types import HANDED_DOWN, SOFT, Path, Prediction, field, pytree, static
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.params import VehicleParams

MICRO_TERMS = (
    "length",
    "obstacle",
    "curvature",
    "curvature_rate",
    "transition",
    "macro",
    "slowness",
    "lateral_acceleration",
    "acceleration",
)
REASONS = (
    "curvature",
    "steering_rate",
    "lateral_acceleration",
    "acceleration",
    "deceleration",
    "collision",
    "off_road",
)
MIN_STEP_TIME = 1e-3  # s between two points, at the least, since rates are divided by it


@pytree
class MicroWeights:
    """Weight of each of MICRO_TERMS; the unit of all of them is metres of way."""

    PINNED: ClassVar[dict[str, str]] = {"length": "scale: the unit of all weights is metres of way"}

    length: float = 1.0  # per m
    obstacle: float = 1.0  # per m^2 of missing clearance and m of way
    curvature: float = 2.0  # per rad of turn
    curvature_rate: float = 200.0  # per 1/m^3
    transition: float = 0.05  # per m beside the previous path and m of way
    macro: float = 0.1  # per m beside the macro plan and m of way
    slowness: float = 0.02  # per m^2/s
    lateral_acceleration: float = 0.05  # per m^2/s^3
    acceleration: float = 0.0  # per m^2/s^3; above 0 prefers the present speed


UNIT = MicroWeights(*[1.0] * len(MICRO_TERMS))


@pytree
class MicroParams:
    """What candidates pay, and what makes them infeasible."""

    PINNED: ClassVar[dict[str, str]] = {
        "kept": "safety: the clearance below which a candidate collides",
        "collision_horizon": "safety: how far ahead a collision makes a candidate infeasible",
        "horizon_fade": "safety: how far ahead a collision makes a candidate infeasible",
        "max_*": "safety: a limit that makes a candidate infeasible",
        "steering_*share": "safety: what the steering can follow",
        "edge_tolerance": "safety: of leaving the road",
        "settle": "safety: how long a limit may be exceeded",
        "recovery*": "safety: how long and how far the road may be left",
        "infeasible": "safety: the price of a broken limit",
        "*_scale": SOFT,
    }

    weights: MicroWeights = MicroWeights()
    clearance: ClearanceParams = ClearanceParams()
    min_clearance: float = 0.6  # m, below which the obstacle term sets in
    kept: float = 0.15  # m, clearance below which a candidate collides: paths are not followed to the centimetre
    collision_horizon: float = 5.0  # s, a collision farther ahead is not one yet
    horizon_fade: float = 1.0  # s, over which obstacles fade out after it
    max_lateral_acceleration: float = 4.0  # m/s^2
    max_acceleration: float = 5.0  # m/s^2, of the assumed speed; what is driven is planned afterwards
    max_deceleration: float = 8.0  # m/s^2, positive
    settle: float = 1.0  # s, for which a limit that the vehicle already exceeds does not count; then this fades as long
    steering_share: float = 0.95  # of the largest curvature that steering can follow
    steering_rate_share: float = 2.0  # of the fastest steering; what is driven turns in more smoothly than a candidate
    edge_tolerance: float = 0.1  # m, by which the footprint may leave the road
    recovery: float = 3.0  # s, for which a vehicle that is off the road may still be so; then this fades as long
    recovery_slack: float = 0.3  # m, by which it may meanwhile be farther off, since it has to turn
    infeasible: float = 1e3  # m, cost of each limit that is broken
    choice_scale: float = 1.0  # m of cost that count as clearly cheaper
    curvature_scale: float = 0.01  # 1/m, clearly within the limit
    acceleration_scale: float = 0.5  # m/s^2
    rate_scale: float = 0.1  # rad/s
    collision_scale: float = 0.2  # m
    edge_scale: float = 0.1  # m
    learned: LearnedCost | None = field(default=None, metadata=HANDED_DOWN)  # added to the weighted terms
    barrier: str = static(default="hinge", metadata={"choices": costs.BARRIERS})


@pytree
class MicroPlan:
    """The chosen candidate, and all that led to the choice."""

    path: Path
    time: Array  # [K] s, of passing each point of the path
    speed: Array  # [K] m/s, assumed there
    weights: Array  # [J] one-hot in mode hard
    terms: Array  # [J, C] weighted cost by MICRO_TERMS
    cost: Array  # [J] their sum and the penalties of broken limits
    reasons: Array  # [J, R] bool, limits of REASONS that a candidate breaks
    margin: Array  # [J] m, smallest clearance within the collision horizon
    chosen: Array  # [] int, the candidate of largest weight
    runner_up: Array  # [] int, the cheapest of the others
    feasible: Array  # [] degree: the choice breaks no limit
    clearance: Array  # [] m, of the choice


def select(fan: Fan, driving: Driving, *, prediction: Prediction, previous: Previous) -> MicroPlan:
    """The cheapest candidate that breaks no limit, or the least bad one where all do (Eq. 24).

    All candidates end at the same station, so that Eq. 24's length does not reward to stay behind. Args: fan, of
    candidates; driving, with MicroParams; prediction, of everybody else; previous, the plan of the step before.
    """
    params, relaxation = driving.params, driving.relaxation
    room = clearance(fan, driving, prediction=prediction)
    terms, margins = judged(fan, driving, room=room, previous=previous)
    change, collision = params.acceleration_scale, params.collision_scale
    scales = (params.curvature_scale, params.rate_scale, change, change, change, collision, params.edge_scale)
    broken = soft.above(-margins, 0.0, relaxation, scale=jnp.stack(scales)[None, :])
    cost = jnp.sum(terms, axis=1) + params.infeasible * jnp.sum(broken, axis=1)
    if params.learned is not None:
        alike = weighted_terms(fan, params.replace(weights=UNIT), room=room, previous=previous)
        cost = cost + params.learned(alike, context_of(fan, room=room))
    weights = soft.choose(cost, relaxation, scale=params.choice_scale)
    chosen, nearest = jnp.argmax(weights), margins[:, REASONS.index("collision")]
    others = jnp.where(jnp.arange(cost.shape[0]) == chosen, jnp.inf, cost)
    feasible = jnp.prod(1 - broken, axis=1)
    each = (fan.offset, fan.position, fan.heading, fan.curvature, fan.time, fan.speed, feasible, nearest)
    offset, position, heading, curvature, time, speed, feasible, clear = soft.mixed(weights, each)
    return MicroPlan(
        path=Path(fan.station, offset, position, heading, curvature),
        time=time,
        speed=speed,
        weights=weights,
        terms=terms,
        cost=cost,
        reasons=margins < 0,
        margin=nearest,
        chosen=chosen,
        runner_up=jnp.argmin(others),
        feasible=feasible,
        clearance=clear,
    )


def judged(
    fan: Fan, driving: Driving, *, room: Float[Array, "j k"], previous: Previous
) -> tuple[Float[Array, "j c"], Float[Array, "j r"]]:
    """What each candidate costs, see `weighted_terms`, and how far it stays within each limit, see `limit_margins`.

    Args: fan, of candidates; driving, with MicroParams; room [J, K] m, clearance at each point; previous, the plan of
    the step before.
    """

    @recomputed
    def each(fan: Fan, driving: Driving, room: Array, previous: Previous) -> tuple[Array, Array]:
        terms = weighted_terms(fan, driving.params, room=room, previous=previous)
        return terms, limit_margins(fan, driving, room=room)

    return kept(each(fan, driving, room, previous))


def fade(time: Float[Array, "*s"], params: MicroParams) -> Float[Array, "*s"]:
    """How much an obstacle counts ahead: 1 within the collision horizon, then falling smoothly to 0.

    Args: time [*s] s.
    """
    return 1 - polynomial.smoothstep(lean.clip((time - params.collision_horizon) / params.horizon_fade, 0.0, 1.0))


def clearance(fan: Fan, driving: Driving, *, prediction: Prediction) -> Float[Array, "j k"]:
    """Smallest gap [J, K] (m) from the ego's box at each point, when it is passed, to any predicted box.

    Args: fan, of candidates; driving, with MicroParams; prediction, of everybody else.
    """
    params = driving.params.clearance
    time = fan.time.reshape(-1)
    passage = Passage(fan.position.reshape(-1, 2), fan.heading.reshape(-1), time)
    room = nearest(passage, driving.of(params), prediction=prediction, ignored=fan.follower)
    return room.reshape(fan.time.shape)


def weighted_terms(
    fan: Fan, params: MicroParams, *, room: Float[Array, "j k"], previous: Previous
) -> Float[Array, "j c"]:
    """Weighted cost terms [J, C] by MICRO_TERMS (Eq. 22-24).

    Args: fan, of candidates; room [J, K] m, clearance at each point; previous, the plan of the step before.
    """
    step = costs.segments(fan.position)
    last, counts = profile(previous, fan.station)
    near = costs.barrier(room, params.min_clearance, kind=params.barrier) * fade(fan.time, params)
    everywhere = jnp.ones_like(fan.station)[None, :]
    terms = {
        "length": step,
        "obstacle": costs.parts(near, step),
        "curvature": costs.curvature(fan.curvature, step),
        "curvature_rate": costs.curvature_rate(fan.curvature, step),
        "transition": costs.deviation(fan.offset, last[None, :], counts=counts[None, :], step=step),
        "macro": costs.deviation(fan.offset, fan.macro_offset[None, :], counts=everywhere, step=step),
        "slowness": costs.slowness(fan.speed, fan.free_speed[None, :], time=fan.time),
        "lateral_acceleration": costs.lateral_acceleration(fan.speed, fan.curvature, time=fan.time),
        "acceleration": costs.acceleration(fan.speed, step, time=fan.time),
    }
    return jnp.sum(jnp.stack([getattr(params.weights, name) * terms[name] for name in MICRO_TERMS], axis=1), axis=-1)


def limit_margins(fan: Fan, driving: Driving, *, room: Float[Array, "j k"]) -> Float[Array, "j r"]:
    """How far each candidate stays within each limit [J, R] of REASONS, negative where it breaks it.

    Args: fan, of candidates; driving, with MicroParams; room [J, K] m, clearance at each point.
    """
    vehicle, params = driving.vehicle, driving.params
    steering = params.steering_share * jnp.tan(jnp.asarray(vehicle.max_steering, room.dtype)) / vehicle.wheelbase
    sharp = jnp.abs(fan.curvature)
    across = fan.speed**2 * sharp
    rate = steering_rate(fan, vehicle)
    gain = jnp.diff(fan.speed**2, axis=1) / (2 * lean.maximum(costs.segments(fan.position), costs.MIN_STEP))
    soon = lean.minimum(room + (1 - fade(fan.time, params)) * params.clearance.far, params.clearance.far)
    outside = off_road(fan, vehicle)
    start = outside[:, :1] + params.recovery_slack * lean.clip(outside[:, :1] / params.edge_tolerance, 0.0, 1.0)

    def left(values: Array, limit: float | Array, start: Array, duration: float | Array) -> Array:
        """What is left up to a limit; no candidate can help what the vehicle does at the start."""
        return limit - (values - start * lean.clip(2 - fan.time / duration, 0.0, 1.0))

    too_sharp = lean.maximum(sharp[:, :1] - steering, 0)
    too_fast = lean.maximum(across[:, :1] - params.max_lateral_acceleration, 0)
    at_points = (
        left(sharp, steering, too_sharp, params.settle),
        left(across, params.max_lateral_acceleration, too_fast, params.settle),
        soon - params.kept,
        left(outside, params.edge_tolerance, start, params.recovery),
    )
    between = (
        params.steering_rate_share * vehicle.max_steering_rate - rate,
        params.max_acceleration - gain,
        params.max_deceleration + gain,
    )
    curvature, lateral, collision, edge = jnp.unstack(safe.minimum(jnp.stack(at_points)))
    turning, acceleration, deceleration = jnp.unstack(safe.minimum(jnp.stack(between)))
    return jnp.stack([curvature, turning, lateral, acceleration, deceleration, collision, edge], axis=-1)


def steering_rate(fan: Fan, vehicle: VehicleParams) -> Float[Array, "j e"]:
    """How fast the wheels have to turn [J, K-1] (rad/s, a magnitude) between points, at the assumed speed.

    Args: fan, of candidates; vehicle.
    """
    steered = vehicle.wheelbase * fan.curvature  # tan of the angle
    middle = (steered[:, 1:] + steered[:, :-1]) / 2
    time = lean.maximum(jnp.diff(fan.time, axis=1), MIN_STEP_TIME)
    return jnp.abs(jnp.diff(steered, axis=1)) / ((1 + middle * middle) * time)


def off_road(fan: Fan, vehicle: VehicleParams) -> Float[Array, "j k"]:
    """Share [J, K] of the ego's footprint across that lies on no lane it may use, times the vehicle's width (m).

    May be used: lanes of the route's direction, and oncoming ones that can be reached where they are used. In a bend
    the ends of the body swing out and its middle cuts in. Args: fan, of candidates; vehicle.
    """
    road = fan.road
    turned = fan.heading - road.heading[None, :]
    cos, sin = jnp.cos(turned), jnp.sin(turned)
    bend = road.curvature[None, :] / 2
    front, rear = vehicle.length - vehicle.rear_overhang, -vehicle.rear_overhang
    ends = [x * sin - bend * x * x for x in (front, rear)]
    half_width = vehicle.width / 2 * jnp.abs(cos)
    low = fan.offset + costs.smaller(costs.smaller(*ends), jnp.zeros_like(sin)) - half_width
    high = fan.offset - costs.smaller(costs.smaller(-ends[0], -ends[1]), jnp.zeros_like(sin)) + half_width
    right, left = road.lane_offset - road.lane_width / 2, road.lane_offset + road.lane_width / 2
    usable = road.present * (1 - road.oncoming * lean.minimum(road.barred, 1))
    # Lane by lane, which needs no array of candidates x points x lanes.
    lanes = (jnp.unstack(x[None], axis=-1) for x in (left, right, usable))
    covers = sum(
        lean.maximum(lean.minimum(high, left) - lean.maximum(low, right), 0) * usable
        for left, right, usable in zip(*lanes, strict=True)
    )
    return vehicle.width * (1 - covers / (high - low))
