"""What every localizer returns."""

import enum

import jaxlie
from jax import Array

from urbanjax.types import pytree


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
