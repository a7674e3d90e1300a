"""The command: steering by pure pursuit, acceleration by speed tracking."""

from jax import Array
from jaxtyping import Float

from urbanjax.control.longitudinal import LongitudinalParams, accelerate
from urbanjax.control.pure_pursuit import PurePursuitParams, steer
from urbanjax.types import Command, Path, VehicleState, pytree
from urbanjax.vehicle.params import VehicleParams


@pytree
class ControlParams:
    """Both controllers."""

    lateral: PurePursuitParams = PurePursuitParams()
    longitudinal: LongitudinalParams = LongitudinalParams()


def follow(
    path: Path,
    reference: Float[Array, ""],
    emergency: Float[Array, ""],
    state: VehicleState,
    vehicle: VehicleParams,
    params: ControlParams,
) -> Command:
    """The command that follows `path` at the `reference` speed in m/s; full braking as `emergency` goes to 1."""
    return Command(
        acceleration=accelerate(state.speed, reference, emergency, params.longitudinal, vehicle),
        steering=steer(path, state, params.lateral, vehicle),
    )
