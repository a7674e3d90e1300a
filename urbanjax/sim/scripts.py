"""What some vehicles do at given times, whatever comes: brake, or move over.

A time within a substep counts for the share of the substep that is left of it, so that the motion is continuous in all
numbers of a script and differentiable by them, without any relaxation.
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.numerics import lean
from urbanjax.types import pytree


@pytree
class Script:
    """What V vehicles do; those that are not scripted drive as they would without it."""

    scripted: Bool[Array, " v"]
    brakes_at: Float[Array, " v"]  # s, of the world's clock
    braking: Float[Array, " v"]  # m/s^2, positive, from then on until it stands; 0: it rolls on at its speed
    moves_at: Float[Array, " v"]  # s, when the lateral move that `Traffic` states begins
    moves_for: Float[Array, " v"]  # s, that it lasts


def accelerated(
    script: Script, wanted: Float[Array, " v"], *, time: Float[Array, ""], dt: float | Array
) -> Float[Array, " v"]:
    """The mean acceleration [m/s^2] of a substep: as wanted until the braking begins.

    Args: script, of V vehicles; wanted [V] m/s^2, without it; time [] s, at which the substep begins; dt [s], of it.
    """
    share = _elapsed(script.brakes_at, time, dt)
    return jnp.where(script.scripted, (1 - share) * wanted - share * script.braking, wanted)


def paces(script: Script, usual: float | Array, *, time: Float[Array, ""], dt: float | Array) -> Float[Array, " v"]:
    """The share of a lateral move [1/s] that is done per second of a substep; none before it begins.

    Args: script, of V vehicles; usual [1/s], of those that are not scripted; time [] s, at which the substep begins;
    dt [s], of it.
    """
    return jnp.where(script.scripted, _elapsed(script.moves_at, time, dt) / script.moves_for, usual)


def _elapsed(begin: Array, time: Array, dt: float | Array) -> Array:
    """The share of a substep that lies after `begin`."""
    return lean.clip((time + dt - begin) / dt, 0.0, 1.0)
