"""The stack that is shown nobody: what seeing others is worth."""

import jax.numpy as jnp
import jaxlie

from urbanjax import stack
from urbanjax.course import Course
from urbanjax.stack import StackInfo, StackParams, StackState
from urbanjax.types import HANDED_DOWN, Command, Mount, Observation, field, pytree
from urbanjax.vehicle.params import VehicleParams


@pytree
class Blind:
    """The stack with its signals and its road, and without objects."""

    vehicle: VehicleParams = field(default=None, metadata=HANDED_DOWN)
    period: float = field(default=None, metadata=HANDED_DOWN)  # s, of one step
    mount: Mount = field(default=None, metadata=HANDED_DOWN)  # of the LiDAR
    stack: StackParams = StackParams()

    @property
    def _stack(self) -> StackParams:
        return self.stack.replace(vehicle=self.vehicle, period=self.period, mount=self.mount)

    def init(self, course: Course, pose: jaxlie.SE2) -> StackState:
        """The stack's. Args: course, of the drive; pose, T_world_body."""
        return stack.init(self._stack, course, pose)

    def step(
        self, course: Course, state: StackState, observation: Observation
    ) -> tuple[Command, StackState, StackInfo]:
        """The stack's step without objects.

        Args: course, of the drive; state, the stack's; observation, of this step.
        """
        seen = observation.objects
        nobody = seen.replace(valid=jnp.zeros_like(seen.valid))
        return stack.step(self._stack, course, state, observation.replace(objects=nobody))
