"""The closed-loop score of the nuPlan devkit, version 1.2.2 (closed_loop_reactive_agents_weighted_average).

Total = product of the gates * weighted mean of the others; a gate at 0 takes everything.

| sub-score | | value |
|---|---|---|
| no collision at fault | gate | 0 with any (see `fault`), vehicles and vulnerable ones alike |
| drivable area | gate | 0 where the box is 0.3 m or more outside |
| driving direction | gate | 1, 0.5 from 2 m, 0 from 6 m against the direction in a second |
| making progress | gate | 0 below a ratio of 0.2 |
| time to collision | 5 | 0 where the least is 0.95 s or less |
| progress | 5 | the ratio of the way made to that of the expert, in [0, 1] |
| speed limit | 4 | 1 - mean overspeed / 2.23 m/s, not below 0 |
| comfort | 2 | 0 where any of the six leaves its bounds |

As there, the last second holds one step more than a second has, the time to collision is looked for at 0.1, 0.2 .. 2.9
s, and the filters are those that its functions are really called with (see `comfort`).

What differs, because the world does:
- Nobody was recorded: the way from the start to the goal stands for the expert's. Its floor is 2 m as in the devkit's
  code and configuration (its documentation says 0.1 m).
- `road_margin` is that of the whole outline of the box; there, that of its corners.
- Ways along lanes are trapezoids of `along`; there, differences of stations, with none in the step of a change of lane
  and the one after it.
- In a junction is the box centre; there, the rear axle.
- Accelerations are those of the rear axle, with v * yaw rate across. There, they are moved to the centre of the box by
  a term that points forwards, and its simulation has none across.
- Reversing keeps its sign in what is projected ahead; there, speeds are magnitudes.
- The ego is always in some lane. Nothing is rounded to 8 decimals.
- A drive shorter than a window is filtered as if it had gone on; there, the window is cut.
- There are no objects (cones, barriers), of which one is forgiven there.
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.evaluation import comfort as feel
from urbanjax.evaluation.facts import Facts
from urbanjax.evaluation.fault import FaultRule, Faults, at_fault, bearing, boxes, further_than, touch
from urbanjax.evaluation.metrics import HARD
from urbanjax.geometry.boxes import Box
from urbanjax.numerics import soft
from urbanjax.numerics.soft import Relaxation
from urbanjax.types import pytree, static
from urbanjax.vehicle.comfort import ComfortParams
from urbanjax.vehicle.params import VehicleParams

# Natural scales of the choices for the relaxation.
SPEED_SCALE = 0.1  # m/s, of standing
MARGIN_SCALE = 0.1  # m, at the edge of the road
AGAINST_SCALE = 0.5  # m, against the direction
WAY_SCALE = 0.5  # m, of having gone backwards
RATIO_SCALE = 0.1  # of progress
LEAST_SCALE = 0.1  # s, between times to collision
TTC_SCALE = 0.5  # s, at their bound
COMFORT_SCALE = 0.1  # share of a bound
WHOLE = 1e-3  # share of a step, by which a second may miss a whole number of them


@pytree
class NuplanParams:
    """Thresholds and weights, as the devkit is configured."""

    still: float = 0.05  # m/s, at or below which somebody stands in a collision
    behind: float = 150.0  # deg off the heading, above which somebody is behind
    ahead: float = 30.0  # deg off the heading, below which somebody is ahead
    outside: float = 0.3  # m, outside the road from which on the drive does not comply
    against: float = 2.0  # m, against the direction from which on half is lost
    far_against: float = 6.0  # m, from which on all is
    horizon: float = 1.0  # s, within which
    least_ratio: float = 0.2  # of progress, below which there is none
    least_way: float = 2.0  # m, what a shorter way counts as
    least_ttc: float = 0.95  # s, at or below which the time to collision is out of bound
    ttc_step: float = 0.1  # s, between projections
    ttc_steps: int = static(default=29)  # of them
    ttc_still: float = 0.005  # m/s, at or below which the ego has no time to collision
    overspeed: float = 2.23  # m/s, that costs everything if driven all the time
    min_longitudinal: float = -4.05  # m/s^2
    max_longitudinal: float = 2.40  # m/s^2
    max_lateral: float = 4.89  # m/s^2
    max_jerk: float = 8.37  # m/s^3, of the magnitude of the acceleration
    max_longitudinal_jerk: float = 4.13  # m/s^3
    max_yaw_rate: float = 0.95  # rad/s
    max_yaw_acceleration: float = 1.93  # rad/s^2
    ttc_weight: float = 5.0
    progress_weight: float = 5.0
    speed_limit_weight: float = 4.0
    comfort_weight: float = 2.0


@pytree
class NuplanSeries:
    """What the score is made of, by step; what follows the end of the drive means nothing."""

    at_fault: Array  # [T] degree to which a collision at fault begins
    margin: Array  # [T] m, to the edge of the road
    advance: Array  # [T] m along the lanes in the last second, negative against their direction
    ttc: Array  # [T] s, the horizon (3 s) where nothing comes within it
    overspeed: Array  # [T] m/s over the limit, or 0
    longitudinal: Array  # [T] m/s^2, smoothed
    lateral: Array  # [T] m/s^2, smoothed
    jerk: Array  # [T] m/s^3, of the magnitude of the acceleration
    longitudinal_jerk: Array  # [T] m/s^3
    yaw_rate: Array  # [T] rad/s
    yaw_acceleration: Array  # [T] rad/s^2


@pytree
class NuplanScore:
    """The score and its parts, all in [0, 1] but the last."""

    total: Array  # []
    no_collision_at_fault: Array  # [] gate
    drivable_area: Array  # [] gate
    driving_direction: Array  # [] gate
    making_progress: Array  # [] gate
    gate: Array  # [] their product
    ttc_within_bound: Array  # []
    progress: Array  # []
    speed_limit: Array  # []
    comfort: Array  # []
    gated_ttc: Array  # [] times the gate, and so are the next three
    gated_progress: Array  # []
    gated_speed_limit: Array  # []
    gated_comfort: Array  # []
    least_ttc: Array  # [] s, the horizon (3 s) where nothing ever comes within it


def score(
    facts: Facts, vehicle: VehicleParams, *, params: NuplanParams | None = None, relaxation: Relaxation = HARD
) -> NuplanScore:
    """The score of one drive; see the table above.

    In mode soft it has a gradient through all that is continuous in the facts; lanes, junctions and the end of the
    drive stay what they are.
    Args: facts, of one drive; vehicle, the ego's dimensions; params, thresholds and weights; relaxation, hard or how
    soft.
    """
    params = NuplanParams() if params is None else params
    faults = _faults(facts, vehicle, params, relaxation)
    steps = _series(facts, vehicle, params, relaxation, faults)

    def least(values: Array, scale: float) -> Array:
        return soft.minimum(values, relaxation, scale=scale, mask=jnp.broadcast_to(facts.alive, values.shape))

    margin, advance, ttc = (
        least(steps.margin, MARGIN_SCALE),
        least(steps.advance, AGAINST_SCALE),
        least(steps.ttc, LEAST_SCALE),
    )
    direction = [
        soft.above(advance, -bound, relaxation, scale=AGAINST_SCALE) for bound in (params.against, params.far_against)
    ]
    ratio = _progress(facts, params, relaxation)
    gates = {
        "no_collision_at_fault": jnp.prod(1 - jnp.sum(faults.at_fault, axis=0)),
        "drivable_area": soft.above(margin, -params.outside, relaxation, scale=MARGIN_SCALE),
        "driving_direction": sum(direction) / 2,
        "making_progress": soft.negate(soft.above(-ratio, -params.least_ratio, relaxation, scale=RATIO_SCALE)),
    }
    gate = jnp.prod(jnp.stack(list(gates.values())))
    within = soft.above(ttc, params.least_ttc, relaxation, scale=TTC_SCALE)
    over = jnp.sum(jnp.where(facts.alive, steps.overspeed, 0)) / jnp.maximum(jnp.sum(facts.alive) - 1, 1)
    speed_limit = jnp.where(jnp.sum(facts.alive) > 1, jnp.maximum(1 - over / params.overspeed, 0), 1)
    felt = feel.Smoothed(**{name: getattr(steps, name) for name in feel.Smoothed.__dataclass_fields__})
    room = [least(x, COMFORT_SCALE) for x in feel.room(felt, _bounds(params))]
    comfort = jnp.prod(jnp.stack([soft.above(x, 0.0, relaxation, scale=COMFORT_SCALE) for x in room]))
    parts = {"ttc_within_bound": within, "progress": ratio, "speed_limit": speed_limit, "comfort": comfort}
    weights = params.ttc_weight, params.progress_weight, params.speed_limit_weight, params.comfort_weight
    gated = jnp.stack([gate * part for part in parts.values()])
    return NuplanScore(
        total=jnp.sum(jnp.asarray(weights, gated.dtype) * gated) / sum(weights),
        **gates,
        gate=gate,
        **parts,
        **dict(zip(("gated_ttc", "gated_progress", "gated_speed_limit", "gated_comfort"), gated, strict=True)),
        least_ttc=ttc,
    )


def series(
    facts: Facts, vehicle: VehicleParams, *, params: NuplanParams | None = None, relaxation: Relaxation = HARD
) -> NuplanSeries:
    """What the score is made of, step by step.

    Args: facts, of one drive; vehicle, the ego's dimensions; params, thresholds; relaxation, hard or how soft.
    """
    params = NuplanParams() if params is None else params
    return _series(facts, vehicle, params, relaxation, _faults(facts, vehicle, params, relaxation))


def _faults(facts: Facts, vehicle: VehicleParams, params: NuplanParams, relaxation: Relaxation) -> Faults:
    return at_fault(facts, vehicle, params=FaultRule(params.still, params.behind), relaxation=relaxation)


def _series(
    facts: Facts, vehicle: VehicleParams, params: NuplanParams, relaxation: Relaxation, faults: Faults
) -> NuplanSeries:
    period = feel.period(facts)
    felt = feel.smoothed(feel.motion(facts), jnp.sum(facts.alive), spacing=period)
    return NuplanSeries(
        at_fault=1 - jnp.prod(1 - faults.at_fault, axis=1),
        margin=facts.road_margin,
        advance=_advance(facts, params, period),
        ttc=_ttc(facts, vehicle, params, relaxation, faults),
        overspeed=jnp.maximum(facts.ego.speed - facts.speed_limit, 0),
        **{name: getattr(felt, name) for name in felt.__dataclass_fields__},
    )


def _advance(facts: Facts, params: NuplanParams, period: Array) -> Float[Array, " t"]:
    """Way along the lanes within the horizon and one step more."""
    way = (facts.along[1:] + facts.along[:-1]) / 2 * (facts.time[1:] - facts.time[:-1])
    so_far = jnp.concatenate([jnp.zeros_like(way[:1]), jnp.cumsum(way)])
    back = jnp.floor(params.horizon / period + WHOLE).astype(jnp.int32) + 1
    return so_far - so_far[jnp.maximum(jnp.arange(so_far.shape[0]) - back, 0)]


def _ttc(
    facts: Facts, vehicle: VehicleParams, params: NuplanParams, relaxation: Relaxation, faults: Faults
) -> Float[Array, " t"]:
    """The first of the times at which boxes moved on at constant velocity touch: a sum over the times free so far."""
    cosine = bearing(facts, vehicle)
    ahead = soft.negate(further_than(cosine, params.ahead, relaxation=relaxation))
    beside = soft.negate(further_than(cosine, params.behind, relaxation=relaxation))
    wide = (~facts.in_one_lane | facts.in_junction)[:, None].astype(cosine.dtype)
    counts = soft.both(faults.apart, soft.either(ahead, soft.both(wide, beside)))
    counts = jnp.where(facts.others.valid, counts, 0)
    times = params.ttc_step * jnp.arange(1, params.ttc_steps + 1)[None, None]

    def moved(one: Box, speed: Array) -> Box:
        ways = speed[..., None] * times
        x, y, cos, sin, half_length, half_width = (getattr(one, name)[..., None] for name in one.__dataclass_fields__)
        return Box(x + ways * cos, y + ways * sin, cos, sin, half_length, half_width)

    own, theirs = boxes(facts)
    touching = touch(moved(own, facts.ego.speed[:, None]), moved(theirs, facts.others.speed), relaxation=relaxation)
    hit = 1 - jnp.prod(1 - counts[..., None] * touching, axis=1)
    moves = soft.above(facts.ego.speed, params.ttc_still, relaxation, scale=SPEED_SCALE)
    free = jnp.cumprod(1 - moves[:, None] * hit, axis=1)
    return params.ttc_step * (1 + jnp.sum(free, axis=1)) * jnp.prod(1 - faults.at_fault, axis=1)


def _progress(facts: Facts, params: NuplanParams, relaxation: Relaxation) -> Float[Array, ""]:
    forwards = soft.negate(soft.above(-facts.way, params.least_way, relaxation, scale=WAY_SCALE))
    reference = jnp.maximum(facts.goal - facts.station[0], params.least_way)
    return forwards * jnp.minimum(jnp.maximum(facts.way, params.least_way) / reference, 1)


def _bounds(params: NuplanParams) -> ComfortParams:
    return ComfortParams(
        acceleration=params.max_longitudinal,
        deceleration=-params.min_longitudinal,
        lateral=params.max_lateral,
        jerk=params.max_jerk,
        longitudinal_jerk=params.max_longitudinal_jerk,
        yaw_rate=params.max_yaw_rate,
        yaw_acceleration=params.max_yaw_acceleration,
    )
