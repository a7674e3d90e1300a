"""The ego vehicle: its state, what its wheels and inertial unit report, and the command it is given."""

import jaxlie
from jax import Array

from urbanjax.types.struct import pytree


@pytree
class VehicleState:
    """Planar state of a vehicle; the reference point is the centre of the rear axle."""

    position: Array  # [2] m, in the map frame
    heading: Array  # [] rad, counter-clockwise from x
    speed: Array  # [] m/s, along the heading
    acceleration: Array  # [] m/s^2, as last applied
    steering: Array  # [] rad, road-wheel angle as last applied

    @property
    def pose(self) -> jaxlie.SE2:
        """T_world_body."""
        return jaxlie.SE2.from_xy_theta(self.position[..., 0], self.position[..., 1], self.heading)


@pytree
class Odometry:
    """What the vehicle measures of itself."""

    speed: Array  # [] m/s
    acceleration: Array  # [] m/s^2
    steering: Array  # [] rad
    yaw_rate: Array  # [] rad/s


@pytree
class Command:
    """What the stack asks of the vehicle."""

    acceleration: Array  # [] m/s^2
    steering: Array  # [] rad, road-wheel angle
