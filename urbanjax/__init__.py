"""Differentiable urban driving: from road graph to steering as one jitted JAX function."""

from urbanjax.course import Course, course_between
from urbanjax.numerics.compiling import compiler_options
from urbanjax.numerics.soft import Relaxation
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.rollout import LoopParams, rollout
from urbanjax.sim.world import SimParams
from urbanjax.stack import StackInfo, StackParams, StackState, init, step
from urbanjax.types import Command, Observation, UrbanJaxError, VehicleState, as_arrays, batched_values, with_values

__all__ = [
    "Command",
    "Course",
    "LoopParams",
    "Observation",
    "Relaxation",
    "RoadGraph",
    "SimParams",
    "StackInfo",
    "StackParams",
    "StackState",
    "UrbanJaxError",
    "VehicleState",
    "as_arrays",
    "batched_values",
    "compiler_options",
    "course_between",
    "init",
    "rollout",
    "step",
    "with_values",
]
