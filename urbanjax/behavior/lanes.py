"""The lanes that behaviour reasons about: the ego lane (Eq. 25-26), the lane that a path leads to."""

from typing import ClassVar

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import safe, soft
from urbanjax.numerics.soft import Relaxation
from urbanjax.roadmap.progress import Sample
from urbanjax.types import SOFT, pytree
from urbanjax.vehicle.driving import Driving

MISSING = 100.0  # m, by which a lane that is not there counts as farther
NEARER = 0.05  # m^2 of squared deviation that one more point ahead has to be worth


@pytree
class LaneParams:
    """How the nearest lane is told."""

    PINNED: ClassVar[dict[str, str]] = {"clear_difference": SOFT}

    stickiness: float = 0.4  # m, by which another lane must be nearer than the present one
    clear_difference: float = 0.5  # m, difference in distance that counts as clear


def route_lane(like: Float[Array, "q"]) -> Float[Array, "q"]:
    """Weights [Q] over the lanes across on the route's own. Args: like [Q], of the shape and dtype of the result."""
    return jnp.zeros_like(like).at[like.shape[0] // 2].set(1)


def nearest_lane(
    here: Sample, driving: Driving, *, offset: Float[Array, ""], previous: Float[Array, "q"]
) -> Float[Array, "q"]:
    """Weights over the lanes across on the one nearest to a lateral `offset` in metres (Eq. 25-26).

    The printed nearest link flips at crossings; lanes here belong to the route's corridor, so connectivity and
    heading hold by construction, and `previous` weights give hysteresis. Args: here, the lanes across at one station,
    which may be there to a degree; driving, with LaneParams; offset [] m; previous [Q], the weights of the step before.
    """
    params = driving.params
    distance = safe.sqrt((here.lane_offset - offset) ** 2 + 1e-6)
    missing = 1 - here.has_lane.astype(distance.dtype)
    cost = distance + MISSING * missing - params.stickiness * previous
    return soft.choose(cost, driving.relaxation, scale=params.clear_difference)


def terminal(
    offset: Float[Array, "k"], lane: Float[Array, "k"], *, scale: float | Array, relaxation: Relaxation
) -> Float[Array, "k"]:
    """Weights over a path's points on its terminal point, where its move to the side is complete (the t of Eq. 28).

    Paths here go on beyond their manoeuvre and may come back, so the terminal point is the one farthest from the ego
    lane; of equally far ones, the nearest. Args: offset, lane [K] m, of the path and of the ego lane's centre; scale m,
    by which a point is clearly farther; relaxation, of the choice.
    """
    later = NEARER * jnp.arange(offset.shape[0]).astype(offset.dtype)
    return soft.choose(later - (offset - lane) ** 2, relaxation, scale=scale)
