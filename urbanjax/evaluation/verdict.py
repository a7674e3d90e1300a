"""All that is said of one drive: columns of every score, whether it succeeded, and what it failed by."""

import dataclasses
import enum
from typing import Any

import jax.numpy as jnp
from jax import Array

from urbanjax.evaluation import fault
from urbanjax.evaluation.facts import Facts
from urbanjax.evaluation.scores import carla, commonroad, competition, nuplan
from urbanjax.evaluation.scores.competition import Violation
from urbanjax.vehicle.params import VehicleParams

STOOD = 0.2  # m/s, below which the ego stood
WHILE = 3.0  # s before the end, in which it stood


class Cause(enum.IntEnum):
    """What a drive failed by: its first violation, or else what kept it from its goal."""

    NONE = 0
    HIT_STANDING = 1
    HIT_MOVING = 2
    LEFT_ROAD = 3
    RAN_RED = 4
    WRONG_WAY = 5
    SPEEDING = 6
    STOOD = 7
    LATE = 8

    @property
    def label(self) -> str:
        """In words."""
        return "success" if self == Cause.NONE else self.name.lower().replace("_", " ")


def judge(facts: Facts, vehicle: VehicleParams) -> dict[str, Array]:
    """Columns [] by name, those of scores with the score's name first.

    Args: facts, of one drive; vehicle, the ego's dimensions.
    """
    qualified = competition.score(facts, vehicle)
    found: dict[str, Any] = {
        "nuplan": nuplan.score(facts, vehicle),
        "carla": carla.score(facts),
        "commonroad": commonroad.cost(facts),
        "competition": qualified,
    }
    columns = {
        f"{name}_{spec.name}": getattr(score, spec.name)
        for name, score in found.items()
        for spec in dataclasses.fields(score)
    }
    counts = columns.pop("competition_violations")
    columns |= {f"competition_{one.name.lower()}": counts[one] for one in Violation}
    when, cause = _first_violation(facts, vehicle)
    success, violated = qualified.success, jnp.isfinite(when)
    late = facts.time > facts.duration - WHILE
    stood = jnp.all(~facts.alive | ~late | (facts.ego.speed < STOOD))
    cause = jnp.where(violated, cause, jnp.where(stood, int(Cause.STOOD), int(Cause.LATE)))
    return columns | {
        "success": success,
        "cause": jnp.where(success, int(Cause.NONE), cause),
        "cause_time_s": jnp.where(success, jnp.nan, jnp.where(violated, when, facts.duration)),
        "way_m": facts.way,
        "duration_s": facts.duration,
    }


def _first_violation(facts: Facts, vehicle: VehicleParams) -> tuple[Array, Array]:
    """Time [] s and Cause [] of the first violation; infinite without one."""
    blamed = fault.at_fault(facts, vehicle).at_fault > 0
    stands = jnp.abs(facts.others.speed) <= fault.FaultRule().still
    wrong = competition.wrongs(facts)
    by_step = {
        Cause.HIT_STANDING: jnp.any(blamed & stands, axis=1),
        Cause.HIT_MOVING: jnp.any(blamed & ~stands, axis=1),
        Cause.LEFT_ROAD: wrong[Violation.OFF_ROAD],
        Cause.RAN_RED: wrong[Violation.RED_LIGHT],
        Cause.WRONG_WAY: wrong[Violation.ONCOMING],
        Cause.SPEEDING: wrong[Violation.SPEEDING],
    }
    times = jnp.stack([jnp.min(jnp.where(steps & facts.alive, facts.time, jnp.inf)) for steps in by_step.values()])
    causes = jnp.asarray([int(cause) for cause in by_step], jnp.int32)
    return jnp.min(times), causes[jnp.argmin(times)]
