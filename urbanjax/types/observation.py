"""What the stack is told at each step. Fields that a variant does not use are None."""

import jaxlie
from jax import Array

from urbanjax.types.objects import Objects
from urbanjax.types.signals import Signals
from urbanjax.types.state import Odometry
from urbanjax.types.struct import pytree


@pytree
class Observation:
    """One step's input: a pose or a scan, odometry, objects and signals."""

    odometry: Odometry
    objects: Objects
    signals: Signals
    pose: jaxlie.SE2 | None = None  # T_world_body, rear axle
    scan: Array | None = None  # [N, 4] x, y, z, reflectivity in the LiDAR frame
    lane_offset: Array | None = None  # [] m, seen offset from the lane centre, left positive
