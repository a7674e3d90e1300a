"""One smooth number for a whole run: what tuning climbs and gradient tests differentiate."""

import functools

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.evaluation.metrics import HARD, checked, clearance, jerk, lateral_acceleration, progress
from urbanjax.numerics import safe
from urbanjax.numerics.soft import Relaxation
from urbanjax.sim.log import Log
from urbanjax.types import POSITIVE, ConfigError, field, pytree
from urbanjax.types.arguments import kind
from urbanjax.vehicle.comfort import ComfortParams
from urbanjax.vehicle.params import VehicleParams

COMFORT = ComfortParams()
SHORTEST = 1e-3  # s, that a run counts as lasting: one of a single step lasts 0


@pytree
class ScoreParams:
    """Weights, and the values at which each term counts 1."""

    progress: float = 1.0  # weight of the mean speed along the road
    clearance: float = 2.0  # weight of the barrier around other vehicles
    road: float = 2.0  # weight of the barrier at the edge of the road
    acceleration: float = 0.1  # weight
    lateral: float = 0.1  # weight of the lateral acceleration
    jerk: float = 0.02  # weight
    lane: float = 0.05  # weight of the distance from the lane's centre
    discomfort: float = 0.0  # weight of coming near accelerations that are uncomfortable
    speed_scale: float = 10.0  # m/s
    clearance_scale: float = 1.5  # m, below which the barrier rises
    road_scale: float = 0.3  # m, likewise
    acceleration_scale: float = 2.0  # m/s^2, for both directions
    jerk_scale: float = 4.0  # m/s^3
    lane_scale: float = 0.5  # m
    most_acceleration: float = field(default=COMFORT.acceleration, metadata=POSITIVE)  # m/s^2, that is comfortable
    most_deceleration: float = field(default=COMFORT.deceleration, metadata=POSITIVE)  # m/s^2, positive
    most_lateral: float = field(default=COMFORT.lateral, metadata=POSITIVE)  # m/s^2
    nearness: float = field(default=0.15, metadata=POSITIVE)  # share of these, within which it is near them


@pytree
class Score:
    """The terms of the score, each a mean over the run, and their weighted sum; more is better."""

    total: Array  # [] their sum
    progress: Array  # [] weighted, positive
    clearance: Array  # [] weighted, not positive, and so are the others
    road: Array  # [] at the edge of the road
    acceleration: Array  # [] along
    lateral: Array  # [] acceleration across
    jerk: Array  # [] along
    lane: Array  # [] distance from the lane's centre
    discomfort: Array  # [] nearness to uncomfortable accelerations


def score(
    log: Log,
    vehicle: VehicleParams | None = None,
    *,
    params: ScoreParams | None = None,
    relaxation: Relaxation = HARD,
) -> Float[Array, ""]:
    """The score [] of one run, smooth in mode soft; more is better, and 1 is driving at `speed_scale` undisturbed.

    Args: log [T], of one run; vehicle, the ego's dimensions; params, weights and scales of the terms; relaxation, hard
    or how soft. Raises ScenarioError for what is no log of one run, ConfigError for params of another kind.
    """
    return terms(log, vehicle, params=params, relaxation=relaxation).total


def terms(
    log: Log,
    vehicle: VehicleParams | None = None,
    *,
    params: ScoreParams | None = None,
    relaxation: Relaxation = HARD,
    counts: Bool[Array, " t"] | None = None,
) -> Score:
    """Score = w_p mean(v) / v_0 - sum w_i mean((x_i / x_i0)^2), with hinges ((1 - margin / scale)+)^2 as barriers.

    Discomfort is the mean of (1 + (x / most - 1) / nearness)+, summed over accelerations along, both ways, and across.
    Args: log [T], of one run; vehicle, the ego's dimensions; params, weights and scales of the terms; relaxation, hard
    or how soft; counts [T], steps up to where the run ended, two or more (default: all of them). Raises as `score`
    does.
    """
    vehicle = checked(log, vehicle, relaxation=relaxation)
    params = ScoreParams() if params is None else params
    kind(params, "params", wanted=ScoreParams, error=ConfigError)
    counts = jnp.ones(log.time.shape, bool) if counts is None else counts
    mean, square = functools.partial(_mean, counts=counts), functools.partial(_square, counts=counts)
    duration = jnp.maximum(safe.maximum(jnp.where(counts, log.time, log.time[0])) - log.time[0], SHORTEST)
    gaps, others = clearance(log, vehicle, relaxation=relaxation)
    gaps = jnp.where(others, gaps, params.clearance_scale)
    across = lateral_acceleration(log, vehicle)
    values = {
        "progress": progress(log)[jnp.sum(counts) - 1] / duration / params.speed_scale,
        "clearance": -mean(_barrier(gaps, params.clearance_scale)),
        "road": -mean(_barrier(log.road_margin, params.road_scale)),
        "acceleration": -square(log.ego.acceleration, params.acceleration_scale),
        "lateral": -square(across, params.acceleration_scale),
        "jerk": -_square(jerk(log), params.jerk_scale, counts=counts[1:]),
        "lane": -square(log.offset, params.lane_scale),
        "discomfort": -mean(_near(log.ego.acceleration, across, params)),
    }
    weighted = {name: getattr(params, name) * value for name, value in values.items()}
    return Score(total=sum(weighted.values(), jnp.zeros_like(duration)), **weighted)


def _near(along: Array, across: Array, params: ScoreParams) -> Array:
    """How near to their bounds accelerations [T] (m/s^2) come: 0 when far, 1 at each bound, and on as fast."""
    braking, aside = -along / params.most_deceleration, jnp.abs(across) / params.most_lateral
    shares = along / params.most_acceleration, braking, aside
    return functools.reduce(jnp.add, (jnp.maximum(1 + (share - 1) / params.nearness, 0.0) for share in shares))


def _barrier(margin: Array, scale: float | Array) -> Array:
    return jnp.maximum(1 - margin / scale, 0.0) ** 2


def _square(values: Array, scale: float | Array, *, counts: Array) -> Array:
    return _mean((values / scale) ** 2, counts)


def _mean(values: Array, counts: Array) -> Array:
    return jnp.sum(jnp.where(counts, values, 0)) / jnp.maximum(jnp.sum(counts), 1).astype(values.dtype)
