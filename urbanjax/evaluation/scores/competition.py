"""The qualification's own score: the goal within the time, without a violation; what violations cost otherwise.

| violation | counted |
|---|---|
| AT_FAULT | collisions at fault by nuPlan's rule (see `fault`), once with each other road user |
| OFF_ROAD | times that the box left the road by more than a tolerance |
| RED_LIGHT | stop lines crossed at red |
| SPEEDING | times that the speed went over the limit by more than a tolerance |
| ONCOMING | times that its centre came to lie in an oncoming lane which may not be used to overtake |

Total = time to the goal (the limit, where it was not reached) + penalty * count over all violations; less is better.
"""

import enum

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.evaluation.facts import Facts
from urbanjax.evaluation.fault import FaultRule, at_fault
from urbanjax.evaluation.metrics import HARD
from urbanjax.numerics import soft
from urbanjax.numerics.soft import Relaxation
from urbanjax.types import field, pytree
from urbanjax.vehicle.params import VehicleParams

EDGE_SCALE = 0.1  # m, natural scale of being off the road for the relaxation
OVERSPEED_SCALE = 0.5  # m/s, of speeding


class Violation(enum.IntEnum):
    """What is counted."""

    AT_FAULT = 0
    OFF_ROAD = 1
    RED_LIGHT = 2
    SPEEDING = 3
    ONCOMING = 4


@pytree
class CompetitionParams:
    """Tolerances and penalties."""

    outside: float = 0.0  # m, that the box may reach over the edge of the road
    overspeed: float = 1.0  # m/s, over the limit
    blame: FaultRule = field(default_factory=FaultRule)
    at_fault_penalty: float = 60.0  # s, and so are the others
    off_road_penalty: float = 20.0
    red_light_penalty: float = 30.0
    speeding_penalty: float = 5.0
    oncoming_penalty: float = 10.0

    @property
    def penalties(self) -> tuple[float | Array, ...]:
        """In seconds, in the order of `Violation`."""
        return (
            self.at_fault_penalty,
            self.off_road_penalty,
            self.red_light_penalty,
            self.speeding_penalty,
            self.oncoming_penalty,
        )


@pytree
class CompetitionScore:
    """What the drive is worth in the qualification."""

    total: Array  # [] s, time and penalties
    success: Array  # [] bool (soft: degree), the goal within the limit without a violation
    reached: Array  # [] bool, the goal within the limit
    time: Array  # [] s, to the goal; the limit where it was not reached
    violations: Array  # [K] int32 (soft: degrees), counts by Violation


def score(
    facts: Facts, vehicle: VehicleParams, *, params: CompetitionParams | None = None, relaxation: Relaxation = HARD
) -> CompetitionScore:
    """The score of one drive; see the table above.

    In mode soft collisions, leaving the road and speeding count by degrees, with a gradient, and success is a degree;
    red lights, lanes and the end of the drive stay what they are. Args: facts, of one drive; vehicle, the ego's
    dimensions; params, tolerances and penalties; relaxation, hard or how soft.
    """
    params = CompetitionParams() if params is None else params
    faults = at_fault(facts, vehicle, params=params.blame, relaxation=relaxation)
    counts = {one: _times(facts, wrong) for one, wrong in _degrees(facts, params, relaxation).items()}
    counts |= {  # events, not spells
        Violation.AT_FAULT: jnp.sum(faults.at_fault),
        Violation.RED_LIGHT: jnp.sum(facts.ran_red & facts.alive).astype(faults.at_fault.dtype),
    }
    violations = jnp.stack([counts[one] for one in Violation])
    time = jnp.where(facts.reached, facts.duration, facts.limit)
    total = time + jnp.sum(jnp.asarray(params.penalties, time.dtype) * violations)
    success = facts.reached * jnp.prod(1 - jnp.minimum(violations, 1))
    if relaxation.mode == "hard":
        success, violations = success > 0, violations.astype(jnp.int32)
    return CompetitionScore(total=total, success=success, reached=facts.reached, time=time, violations=violations)


def wrongs(facts: Facts, *, params: CompetitionParams | None = None) -> dict[Violation, Bool[Array, " t"]]:
    """The steps [T] in which each violation but collisions goes on.

    Args: facts, of one drive; params, tolerances.
    """
    params = CompetitionParams() if params is None else params
    return {one: degree > 0 for one, degree in _degrees(facts, params, HARD).items()}


def _degrees(facts: Facts, params: CompetitionParams, relaxation: Relaxation) -> dict[Violation, Float[Array, " t"]]:
    """The degree to which each violation but collisions goes on."""
    outside = soft.above(-facts.road_margin, params.outside, relaxation, scale=EDGE_SCALE)
    limit = facts.speed_limit + params.overspeed
    return {
        Violation.OFF_ROAD: outside,
        Violation.RED_LIGHT: facts.ran_red.astype(outside.dtype),
        Violation.SPEEDING: soft.above(facts.ego.speed, limit, relaxation, scale=OVERSPEED_SCALE),
        Violation.ONCOMING: facts.wrong_way.astype(outside.dtype),
    }


def _times(facts: Facts, degree: Float[Array, " t"]) -> Float[Array, ""]:
    """How often something became true while the drive lasted: all that its degree rose."""
    degree = degree * facts.alive
    before = jnp.concatenate([jnp.zeros_like(degree[:1]), degree[:-1]])
    return jnp.sum(jnp.maximum(degree - before, 0))
