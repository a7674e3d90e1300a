"""What a recorded driver saw at a moment, and what it did then."""

from jax import Array

from urbanjax.planning.situation import Situation
from urbanjax.types import pytree
from urbanjax.vehicle.params import VehicleParams


@pytree
class Demonstration:
    """A moment of a drive, or N of them stacked along the first axis."""

    situation: Situation  # everybody else as observed then; nothing of it knows what came after
    vehicle: VehicleParams  # of the driver's size
    time: Array  # [H] s after the moment
    position: Array  # [H, 2] m, centre of the driver's box then
    heading: Array  # [H] rad
    valid: Array  # [H] bool, times that the record reaches
