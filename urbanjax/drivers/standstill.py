"""The driver that does not drive."""

import jax.numpy as jnp
import jaxlie

from urbanjax.course import Course
from urbanjax.types import HANDED_DOWN, Command, Observation, field, pytree
from urbanjax.vehicle.params import VehicleParams


@pytree
class Standstill:
    """Brakes in full and stands: what a score gives for nothing."""

    vehicle: VehicleParams = field(default=None, metadata=HANDED_DOWN)

    def init(self, course: Course, pose: jaxlie.SE2) -> tuple[()]:
        """Nothing is remembered. Args: course, of the drive; pose, T_world_body."""
        return ()

    def step(self, course: Course, state: tuple[()], observation: Observation) -> tuple[Command, tuple[()], None]:
        """Full braking. Args: course, of the drive; state, none; observation, of the speed."""
        speed = observation.odometry.speed
        moving = (speed > 0).astype(speed.dtype)
        return Command(-self.vehicle.max_deceleration * moving, jnp.zeros_like(speed)), (), None
