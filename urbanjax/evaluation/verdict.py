"""All that is said of one drive: every score's columns by name."""

from jax import Array

from urbanjax.evaluation.facts import Facts
from urbanjax.vehicle.params import VehicleParams


def judge(facts: Facts, vehicle: VehicleParams) -> dict[str, Array]:
    """Columns [] by name with unit. Args: facts, of one drive; vehicle, the ego's dimensions."""
    return {
        "reached": facts.reached,
        "way_m": facts.way,
        "duration_s": facts.duration,
        "touched": facts.touches.any(),
        "red": facts.ran_red.any(),
        "off": ((facts.road_margin < 0) & facts.alive).any(),
    }
