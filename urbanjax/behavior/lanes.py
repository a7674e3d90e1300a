"""The lanes that behaviour reasons about: the ego lane (Eq. 25-26), the lane that a path leads to."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import safe, soft
from urbanjax.numerics.soft import Relaxation
from urbanjax.roadmap.extended import ExtendedGraph, Sample, sample
from urbanjax.types import pytree


@pytree
class LaneParams:
    """How the nearest lane is told."""

    stickiness: float = 0.4  # m, by which another lane must be nearer than the present one
    clear_difference: float = 0.5  # m, difference in distance that counts as clear


def nearest_lane(
    here: Sample,
    offset: Float[Array, ""],
    previous: Float[Array, "q"],
    params: LaneParams,
    relaxation: Relaxation,
) -> Float[Array, "q"]:
    """Weights over the lanes across on the one nearest to a lateral `offset` in metres (Eq. 25-26).

    The printed nearest link flips at crossings; lanes here belong to the route's corridor, so connectivity and
    heading hold by construction, and `previous` weights give hysteresis.
    """
    distance = safe.sqrt((here.lane_offset - offset) ** 2 + 1e-6)
    return soft.choose(
        distance - params.stickiness * previous, relaxation, scale=params.clear_difference, mask=here.has_lane
    )


def lane_profile(extended: ExtendedGraph, station: Float[Array, "k"], weights: Float[Array, "q"]) -> Float[Array, "k"]:
    """Offset in metres of the weighted lane's centre at each station."""
    return sample(extended, station).lane_offset @ weights


def has_any(weights: Float[Array, "q"], mask: Array) -> Float[Array, ""]:
    """Degree to which the weighted lane has a property. Args: mask [Q] bool."""
    return jnp.sum(weights * mask.astype(weights.dtype))
