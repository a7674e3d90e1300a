"""The sliding window of the point-cloud map: its radius grows with the speed (Eq. 6-7)."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.registration.distributions import DistributionMap
from urbanjax.registration.voxelmap import CutParams, VoxelMap, cut
from urbanjax.types import pytree


@pytree
class SlidingParams:
    """How far the map is looked at. The paper gives no law for psi(v); Table I uses 70 to 100 m."""

    standing: float = 70.0  # m, at standstill
    per_speed: float = 1.8  # m per m/s
    smallest: float = 70.0  # m
    largest: float = 100.0  # m
    cut: CutParams = CutParams()


def radius(speed: Float[Array, ""], params: SlidingParams) -> Float[Array, ""]:
    """Psi(v) = clip(psi_0 + k v, psi_min, psi_max) in m (Eq. 7). Args: speed [] m/s."""
    return jnp.clip(params.standing + params.per_speed * speed, params.smallest, params.largest)


def window(
    world: VoxelMap, position: Float[Array, "3"], *, speed: Float[Array, ""], params: SlidingParams
) -> tuple[DistributionMap, Array]:
    """The map within psi(v) of a position [3] m, and how many of its voxels found no place.

    Args: world, the point-cloud map; position [3] m, in its frame; speed [] m/s.
    """
    return cut(world, position, radius=radius(speed, params), params=params.cut)
