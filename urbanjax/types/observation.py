"""What the stack is told at each step. Fields that a variant does not use are None."""

import jaxlie
from jax import Array

from urbanjax.types.objects import Objects
from urbanjax.types.scan import Scan
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
    scan: Scan | None = None  # stamped now
    lane_offset: Array | None = None  # [] m, seen offset from the lane centre, left positive
