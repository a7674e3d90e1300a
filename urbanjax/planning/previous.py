"""The plan of the step before, against which the transition terms compare at equal station (Eq. 14, 23)."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.planning.basis import interpolate
from urbanjax.types import pytree


@pytree
class Previous:
    """A lateral profile over a uniform station grid."""

    station: Array  # [n] m along the route
    offset: Array  # [n] m, left positive
    valid: Array  # [] 0 or 1: there was a plan


def nothing(n: int) -> Previous:
    """What a first step compares with: a grid of stations that does not count. Args: n, how many they are."""
    return Previous(station=jnp.arange(n, dtype=jnp.zeros(()).dtype), offset=jnp.zeros(n), valid=jnp.zeros(()))


def remember(station: Float[Array, "n"], offset: Float[Array, "n"]) -> Previous:
    """A plan for the next step to compare with. Args: station [n] m, uniform; offset [n] m."""
    return Previous(station=station, offset=offset, valid=jnp.ones_like(station[0]))


def profile(previous: Previous, station: Float[Array, "k"]) -> tuple[Float[Array, "k"], Float[Array, "k"]]:
    """The previous offset [K] (m) and how much it counts [K], fading to 0 one spacing past its end.

    Args: previous, the plan of the step before; station [K] m, along the route.
    """
    spacing = previous.station[1] - previous.station[0]
    offset = interpolate(station, previous.station[0], spacing, previous.offset)
    inside = jnp.clip((previous.station[-1] - station) / spacing + 1, 0, 1)
    return offset, inside * previous.valid
