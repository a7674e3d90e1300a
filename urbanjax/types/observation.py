"""What the stack is told at each step. Fields that a variant does not use are None."""

import jax.numpy as jnp
import jaxlie
from jax import Array

from urbanjax.types.objects import Objects
from urbanjax.types.scan import Scan
from urbanjax.types.signals import Signals
from urbanjax.types.state import Odometry
from urbanjax.types.struct import pytree


@pytree
class LaneOffset:
    """Where a camera saw the vehicle in its lane: what is not valid or too old is not known."""

    offset: Array  # [] m, of the vehicle from the lane's centre, left positive
    valid: Array  # [] bool, the lane was seen
    age: Array  # [] s, since then

    def known(self, longest: float | Array) -> Array:
        """Whether it may be acted upon, [] bool. Args: longest [] s, age up to which it counts."""
        return self.valid & jnp.isfinite(self.offset) & (self.age <= longest)


@pytree
class Observation:
    """One step's input: a pose or a scan, odometry, objects and signals."""

    odometry: Odometry
    objects: Objects  # in the frame of the pose where that is given, else in the body frame: as they are seen
    signals: Signals
    pose: jaxlie.SE2 | None = None  # T_world_body, rear axle
    scan: Scan | None = None  # stamped now
    lane_offset: LaneOffset | None = None
