"""The command: steering by pure pursuit, acceleration by speed tracking."""

from jax import Array
from jaxtyping import Float

from urbanjax.control.longitudinal import LongitudinalParams, accelerate
from urbanjax.control.pure_pursuit import PurePursuitParams, steer
from urbanjax.types import Command, Path, VehicleState, pytree
from urbanjax.vehicle.driving import Driving


@pytree
class ControlParams:
    """Both controllers."""

    lateral: PurePursuitParams = PurePursuitParams()
    longitudinal: LongitudinalParams = LongitudinalParams()


def follow(
    path: Path, driving: Driving, *, reference: Float[Array, ""], emergency: Float[Array, ""], state: VehicleState
) -> Command:
    """The command that follows a path at a speed.

    Args: path; driving, with ControlParams; reference [] m/s, the speed; emergency [], the share of full braking;
    state, of the ego.
    """
    params = driving.params
    return Command(
        acceleration=accelerate(
            state.speed,
            driving.of(params.longitudinal),
            previous=state.acceleration,
            reference=reference,
            emergency=emergency,
        ),
        steering=steer(path, driving.of(params.lateral), state=state),
    )
