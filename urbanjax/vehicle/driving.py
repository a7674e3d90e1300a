"""What every stage of a driver works with."""

from typing import Any

from urbanjax.numerics.soft import Relaxation
from urbanjax.types import pytree
from urbanjax.vehicle.params import VehicleParams


@pytree
class Driving:
    """The vehicle that is driven, the params of one stage, how hard its choices are, and how often it is asked."""

    vehicle: VehicleParams
    params: Any  # of the stage
    relaxation: Relaxation
    period: float  # s, of one step

    def of(self, params: Any) -> "Driving":
        """The same for another stage, with its params."""
        return self.replace(params=params)
