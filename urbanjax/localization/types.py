"""What every localizer returns."""

import enum
from typing import Any

import jax.numpy as jnp
import jaxlie
from jax import Array

from urbanjax.types import Observation, Odometry, VehicleState, pytree


class Health(enum.IntEnum):
    """How far the pose can be trusted, and what it rests on."""

    NORMAL = 0  # registration on the map
    PREDICT = 1  # registration failed: odometry carries the pose on
    LANE = 2  # likewise for long, held in the lane that the camera sees
    RELOCALIZE = 3  # likewise without a lane: the pose has to be found anew
    STOP = 4  # nothing helped: stand still


class Sign(enum.IntEnum):
    """By-products of a registration that tell of its failure."""

    INLIERS = 0  # few correspondences
    RESIDUAL = 1  # they fit badly
    WEAKEST = 2  # a direction that nothing is known about
    ITERATIONS = 3  # it did not converge
    INNOVATION = 4  # far from the prediction
    SPREAD = 5  # other starts end elsewhere
    LANE = 6  # off the lane that the map shows
    SCAN = 7  # no scan


@pytree
class Localization:
    """A pose, its uncertainty and its health."""

    pose: jaxlie.SE2  # T_world_body, rear axle
    covariance: Array  # [3, 3] of (x, y, heading) in the body frame; m^2, m rad, rad^2
    health: Array  # [] int32, a Health
    info: Any = None  # what the variant says of itself

    def brake(self, emergency: Array) -> Array:
        """The share of full braking: that of an `emergency`, and all of it where the pose is lost."""
        return jnp.where(self.health == Health.STOP, jnp.ones_like(emergency), emergency)

    def in_world(self, observation: Observation) -> Observation:
        """The observation with its objects in the frame of the pose: those seen from the vehicle are where it believes.

        Args: observation, of this step; one with a pose is returned as it is.
        """
        if observation.pose is not None:
            return observation
        return observation.replace(objects=observation.objects.seen_from(self.pose))

    def vehicle_state(self, odometry: Odometry) -> VehicleState:
        """The vehicle at this pose, moving as the odometry says."""
        return VehicleState(
            position=self.pose.translation(),
            heading=self.pose.rotation().as_radians(),
            speed=odometry.speed,
            acceleration=odometry.acceleration,
            steering=odometry.steering,
        )
