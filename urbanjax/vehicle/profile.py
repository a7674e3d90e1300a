"""The speed that a vehicle would drive along a path with nobody in front."""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import lean, safe
from urbanjax.types import pytree


@pytree
class ProfileParams:
    """How briskly a free-flow profile changes its speed."""

    PINNED: ClassVar[dict[str, str]] = {"floor": "numerics: arrival times are finite at standstill"}

    acceleration: float = 1.5  # m/s^2
    deceleration: float = 2.0  # m/s^2, positive
    floor: float = 0.5  # m/s, so that arrival times stay finite at standstill


def free_flow(
    speed: Float[Array, ""], cap: Float[Array, "k"], *, distance: Float[Array, "k"], params: ProfileParams
) -> tuple[Float[Array, "k"], Float[Array, "k"]]:
    """Speed [K] (m/s) and arrival time [K] (s) along a path without traffic.

    The squared speed is the least of three: what acceleration allows from the start, the cap here, and what
    deceleration needs for the caps ahead. Args: speed [] m/s, at the start; cap [K] m/s; distance [K] m from the start,
    increasing from 0.
    """
    from_start = speed**2 + 2 * params.acceleration * distance
    # Which points lie ahead is told by index: in a fused loop a distance may differ from itself in the last digit.
    index = np.arange(distance.shape[0])
    gap_ahead = lean.maximum(distance[None, :] - distance[:, None], 0)
    to_caps = cap[None, :] ** 2 + 2 * params.deceleration * gap_ahead
    to_caps = lean.where(jnp.asarray(index[None, :] >= index[:, None]), to_caps, jnp.inf)
    squared = lean.minimum(from_start, safe.minimum(to_caps))
    profile = safe.sqrt(squared + params.floor**2)
    step = 2 * jnp.diff(distance) / (profile[1:] + profile[:-1])
    return profile, lean.running_sum(step)
