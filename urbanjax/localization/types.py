"""What every localizer returns."""

import enum

import jaxlie
from jax import Array

from urbanjax.types import Odometry, VehicleState, pytree


class Health(enum.IntEnum):
    """How far the pose can be trusted."""

    NORMAL = 0
    PREDICT = 1
    LANE = 2
    RELOCALIZE = 3
    STOP = 4


@pytree
class Localization:
    """A pose, its uncertainty and its health."""

    pose: jaxlie.SE2  # T_world_body, rear axle
    covariance: Array  # [3, 3] of (x, y, heading) in the body frame; m^2, m rad, rad^2
    health: Array  # [] int32, a Health

    def vehicle_state(self, odometry: Odometry) -> VehicleState:
        """The vehicle at this pose, moving as the odometry says."""
        return VehicleState(
            position=self.pose.translation(),
            heading=self.pose.rotation().as_radians(),
            speed=odometry.speed,
            acceleration=odometry.acceleration,
            steering=odometry.steering,
        )
