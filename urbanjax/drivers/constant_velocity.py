"""The driver that goes on as it does."""

import jax.numpy as jnp
import jaxlie

from urbanjax.course import Course
from urbanjax.types import Command, Observation, pytree


@pytree
class ConstantVelocity:
    """Straight on at the speed that it has, whatever comes."""

    def init(self, course: Course, pose: jaxlie.SE2) -> tuple[()]:
        """Nothing is remembered. Args: course, of the drive; pose, T_world_body."""
        return ()

    def step(self, course: Course, state: tuple[()], observation: Observation) -> tuple[Command, tuple[()], None]:
        """No acceleration, no steering. Args: course, of the drive; state, none; observation, unused."""
        nothing = jnp.zeros_like(observation.odometry.speed)
        return Command(nothing, nothing), (), None
