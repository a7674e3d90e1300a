"""What a run is judged by. Each function takes the `Log` of one run (T steps); batches go through vmap.

Thresholds and minima have a soft twin through the `Relaxation`; where a quantity is hard only, it is said.
"""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.geometry.boxes import Box, box, box_gap, relaxed_box_gap
from urbanjax.numerics import safe, soft
from urbanjax.numerics.soft import Relaxation
from urbanjax.sim.log import Log, check
from urbanjax.traffic.safety.boxes import box_time_to_collision
from urbanjax.types import ConfigError, Objects, pytree
from urbanjax.types.arguments import kind
from urbanjax.vehicle.params import VehicleParams

HARD = Relaxation()
APART = 1e3  # m, what stands in for the gap to a vehicle that is not there; masked in all that leaves this module
TTC_SCALE = 0.1  # 1/s, natural scale of inverse times to collision for the relaxation
AHEAD_SCALE = 5.0  # m, natural scale of "ahead"
LEAST_GAP = 0.1  # m, below which a gap counts as this one


@pytree
class Metrics:
    """Scalars of one run."""

    progress: Array  # [] m along the road
    clearance: Array  # [] m, smallest gap between the ego's box and another; meaningless where `alone`
    alone: Array  # [] bool, no other vehicle was ever there
    collision: Array  # [] degree in [0, 1]
    ttc_lane: Array  # [] s, smallest time to collision along the lane, inf if never
    ttc_box: Array  # [] s, smallest time to collision of the boxes at constant velocity (hard), inf if never
    mean_speed: Array  # [] m/s
    min_speed: Array  # [] m/s
    speed_drop: Array  # [] m/s, initial speed less the smallest
    max_acceleration: Array  # [] m/s^2, greatest magnitude
    max_lateral: Array  # [] m/s^2, greatest magnitude of lateral acceleration
    max_jerk: Array  # [] m/s^3, greatest magnitude
    off_road: Array  # [] degree in [0, 1]


def evaluate(log: Log, vehicle: VehicleParams | None = None, *, relaxation: Relaxation = HARD) -> Metrics:
    """All metrics of one run; batches go through vmap.

    Args: log [T], of one run; vehicle, the ego's dimensions (default: the standard ones); relaxation, hard or how soft.
    Raises ScenarioError for what is no log of one run, ConfigError for params of another kind.
    """
    vehicle = checked(log, vehicle, relaxation=relaxation)
    gaps, others = clearance(log, vehicle, relaxation=relaxation)
    urgency = _largest(inverse_ttc(log, vehicle, relaxation=relaxation), relaxation, TTC_SCALE)
    closing = urgency > 0
    speed = log.ego.speed
    lowest = soft.minimum(speed, relaxation)
    return Metrics(
        progress=progress(log)[-1],
        clearance=soft.minimum(gaps, relaxation, mask=others, fill=APART),
        alone=~jnp.any(others),
        collision=collision(log, vehicle, relaxation=relaxation),
        ttc_lane=jnp.where(closing, 1 / jnp.where(closing, urgency, 1.0), jnp.inf),
        ttc_box=safe.minimum(box_ttc(log, vehicle)),
        mean_speed=jnp.mean(speed),
        min_speed=lowest,
        speed_drop=speed[0] - lowest,
        max_acceleration=_largest(jnp.abs(log.ego.acceleration), relaxation),
        max_lateral=_largest(jnp.abs(lateral_acceleration(log, vehicle)), relaxation),
        max_jerk=_largest(jnp.abs(jerk(log)), relaxation),
        off_road=off_road(log, relaxation),
    )


def checked(log: Log, vehicle: VehicleParams | None, *, relaxation: Relaxation = HARD) -> VehicleParams:
    """The vehicle, by default the standard one. Raises as `evaluate` does.

    Args: log, of one run; vehicle, the ego's dimensions; relaxation, hard or how soft.
    """
    check(log)
    vehicle = VehicleParams() if vehicle is None else vehicle
    kind(vehicle, "vehicle", wanted=VehicleParams, error=ConfigError)
    kind(relaxation, "relaxation", wanted=Relaxation, error=ConfigError)
    return vehicle


def _largest(values: Array, relaxation: Relaxation, scale: float = 1.0) -> Array:
    return -soft.minimum(-values, relaxation, scale=scale)


def progress(log: Log) -> Float[Array, " t"]:
    """Way made along the road since the first step [m]: the speed along the lane, integrated by trapezoids.

    Args: log, of one run.
    """
    steps = 0.5 * (log.along[1:] + log.along[:-1]) * (log.time[1:] - log.time[:-1])
    return jnp.concatenate([jnp.zeros_like(log.time[:1]), jnp.cumsum(steps)])


def _boxes(log: Log, vehicle: VehicleParams) -> tuple[Box, Box]:
    """The ego's box [T, 1] and the others' [T, V]."""
    length, width = _size(vehicle, log.time.dtype)
    ego = box(log.centre[:, None, :], log.ego.heading[:, None], length=length, width=width)
    others = log.traffic
    return ego, box(others.position, others.heading, length=others.length, width=others.width)


def _size(vehicle: VehicleParams, dtype: jnp.dtype) -> tuple[Array, Array]:
    return jnp.full((1, 1), vehicle.length, dtype), jnp.full((1, 1), vehicle.width, dtype)


def clearance(
    log: Log, vehicle: VehicleParams, *, relaxation: Relaxation
) -> tuple[Float[Array, " t"], Bool[Array, " t"]]:
    """Smallest separating-axis gap to another vehicle [m] per step, negative in a collision; whether there is one.

    Where there is none the gap means nothing. Args: log, of one run; vehicle, the ego's dimensions; relaxation, hard or
    how soft.
    """
    gaps = relaxed_box_gap(*_boxes(log, vehicle), relaxation=relaxation)
    there = log.traffic.valid
    return soft.minimum(gaps, relaxation, mask=there, fill=APART), jnp.any(there, axis=-1)


def collision(log: Log, vehicle: VehicleParams, *, relaxation: Relaxation) -> Float[Array, ""]:
    """Degree to which the ego ever touched another vehicle; soft twin with a scale of 1 m.

    Args: log, of one run; vehicle, the ego's dimensions; relaxation, hard or how soft.
    """
    gaps, others = clearance(log, vehicle, relaxation=relaxation)
    return soft.above(-soft.minimum(gaps, relaxation, mask=others, fill=APART), 0.0, relaxation)


def off_road(log: Log, relaxation: Relaxation) -> Float[Array, ""]:
    """Degree to which a corner of the ego's box ever left the road; soft twin with a scale of 1 m.

    Args: log, of one run; relaxation, hard or how soft.
    """
    return soft.above(-soft.minimum(log.road_margin, relaxation), 0.0, relaxation)


def inverse_ttc(log: Log, vehicle: VehicleParams, *, relaxation: Relaxation) -> Float[Array, " t"]:
    """Greatest closing speed over gap [1/s] per step, among vehicles ahead in the ego's way; 0 when none closes.

    One-dimensional: distances are taken along the ego's heading, sideways off the arc that it steers. The inverse is
    continuous where the time to collision is not (it passes through infinity). Args: log, of one run; vehicle, the
    ego's dimensions; relaxation, hard or how soft.
    """
    others, ego = log.traffic, log.ego
    cos, sin = jnp.cos(ego.heading)[:, None], jnp.sin(ego.heading)[:, None]
    dx, dy = (others.position[..., i] - log.centre[:, i, None] for i in range(2))
    ahead, across = dx * cos + dy * sin, dy * cos - dx * sin
    turn = jnp.tan(ego.steering)[:, None] / vehicle.wheelbase
    turned = others.heading - ego.heading[:, None]
    c, s = jnp.abs(jnp.cos(turned)), jnp.abs(jnp.sin(turned))
    half_length = 0.5 * (others.length * c + others.width * s + vehicle.length)
    half_width = 0.5 * (others.length * s + others.width * c + vehicle.width)
    in_way = soft.above(half_width - jnp.abs(across - 0.5 * turn * ahead * ahead), 0.0, relaxation)
    in_way = jnp.where(others.valid, in_way * soft.above(ahead, 0.0, relaxation, scale=AHEAD_SCALE), 0)
    closing = jnp.maximum(ego.speed[:, None] - others.speed * jnp.cos(turned), 0.0)
    urgency = in_way * closing / jnp.maximum(ahead - half_length, LEAST_GAP)
    # A soft maximum of nothing but zeros is above 0: taken off, it leaves 0 where nobody closes.
    nobody = _largest(jnp.zeros_like(urgency), relaxation, TTC_SCALE)
    return _largest(urgency, relaxation, TTC_SCALE) - nobody


def box_ttc(log: Log, vehicle: VehicleParams) -> Float[Array, " t"]:
    """Time until the ego's box meets another [s] per step, all at constant velocity and heading; inf if never.

    Hard only: it jumps where boxes just miss. Args: log, of one run; vehicle, the ego's dimensions.
    """
    length, width = _size(vehicle, log.time.dtype)
    heading, speed = log.ego.heading[:, None], log.ego.speed[:, None]
    ego = Objects(log.centre[:, None], heading, speed, length, width, valid=jnp.ones((1, 1), bool))
    return safe.minimum(box_time_to_collision(ego, log.traffic))


def jerk(log: Log) -> Float[Array, " s"]:
    """Longitudinal jerk between steps [m/s^3], one fewer than steps. Args: log, of one run."""
    steps = log.time[1:] - log.time[:-1]
    return safe.divide(log.ego.acceleration[1:] - log.ego.acceleration[:-1], steps)


def lateral_acceleration(log: Log, vehicle: VehicleParams) -> Float[Array, " t"]:
    """Lateral acceleration of the rear axle [m/s^2], v^2 tan(delta) / wheelbase.

    Args: log, of one run; vehicle, for its wheelbase.
    """
    return log.ego.speed**2 * jnp.tan(log.ego.steering) / vehicle.wheelbase


def overlaps(objects: Objects) -> Bool[Array, "v v"]:
    """Which valid vehicles touch which others, all pairs; the diagonal is False. Args: objects [V], boxes."""
    every = box(objects.position, objects.heading, length=objects.length, width=objects.width)
    one = Box(*(getattr(every, name)[:, None] for name in every.__dataclass_fields__))
    two = Box(*(getattr(every, name)[None, :] for name in every.__dataclass_fields__))
    touching = box_gap(one, two) <= 0
    n = objects.valid.shape[0]
    return touching & objects.valid[:, None] & objects.valid[None, :] & ~jnp.eye(n, dtype=bool)


def tracks(log: Log, vehicle: VehicleParams | None = None) -> Objects:
    """Everybody in the log of one run as boxes [T, 1 + V], the ego first: what measures of traffic take.

    Args: log [T], of one run; vehicle, the ego's dimensions (default: the standard ones).
    """
    vehicle = checked(log, vehicle, relaxation=HARD)
    own, others = log.ego, log.traffic
    length, width = (jnp.full_like(own.speed, size) for size in (vehicle.length, vehicle.width))
    ego = Objects(log.centre, own.heading, own.speed, length, width, valid=jnp.ones(own.speed.shape, bool))
    ego = ego if others.kind is None else ego.with_kinds()
    return jax.tree.map(lambda a, b: jnp.concatenate([a[:, None], b], axis=1), ego, others)
