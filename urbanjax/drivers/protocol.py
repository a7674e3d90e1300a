"""What the closed loop asks of a driver."""

import abc
from typing import Any, Protocol

import jaxlie

from urbanjax.course import Course
from urbanjax.types import Command, Observation


class Driver(Protocol):
    """The params of a driver, a pytree; what it carries from step to step is its own affair, but of static shapes.

    Fields `vehicle`, `period` and `mount`, where there are any, are filled in by the loop (`types.HANDED_DOWN`).
    """

    @abc.abstractmethod
    def init(self, course: Course, pose: jaxlie.SE2) -> Any:
        """The state before the first step. Args: course, of the drive; pose, T_world_body of the rear axle."""

    @abc.abstractmethod
    def step(self, course: Course, state: Any, observation: Observation) -> tuple[Command, Any, Any]:
        """One step: command, next state, and whatever is worth keeping. Pure.

        Args: course, of the drive; state, what is remembered; observation, of this step.
        """
