"""One vehicle as another one sees it: along and across the other one's heading."""

import jax
import jax.numpy as jnp
from jax import Array

from urbanjax.types import Objects, pytree

STILL = 1e-6  # m/s, a slower speed counts as none: it is what float32 leaves of equal speeds


@pytree
class Relative:
    """The other vehicle in the frame of one's own box."""

    ahead: Array  # [*s] m, of its centre before one's own
    left: Array  # [*s] m, of its centre to the left of one's own
    reach_along: Array  # [*s] m, both half extents along one's heading
    reach_across: Array  # [*s] m, both half extents across it
    own_speed: Array  # [*s] m/s
    speed_along: Array  # [*s] m/s, of the other one, along one's heading
    speed_across: Array  # [*s] m/s, of the other one, to one's left
    valid: Array  # [*s] bool, both are present

    @property
    def gap(self) -> Array:
        """Distance along one's heading between the boxes [m], negative while they overlap in that direction."""
        return jnp.abs(self.ahead) - self.reach_along

    @property
    def side_gap(self) -> Array:
        """Distance across one's heading between the boxes [m], negative while they overlap in that direction."""
        return jnp.abs(self.left) - self.reach_across


def present(objects: Objects) -> Objects:
    """The same objects with zeros for those that are absent, whose entries may be anything, NaN too.

    Args: objects [*s].
    """

    def clear(x: Array) -> Array:
        valid = objects.valid.reshape(objects.valid.shape + (1,) * (x.ndim - objects.valid.ndim))
        return jnp.where(valid, x, jnp.zeros((), x.dtype))

    return jax.tree.map(clear, objects)


def relative(own: Objects, other: Objects) -> Relative:
    """`other` in the frame of `own`, element by element.

    Objects move along their heading. Differentiable, but for the reaches where the headings are parallel or square.
    Args: own, other, objects of broadcastable shapes [*s] of one rank.
    """
    own, other = present(own), present(other)
    away = other.position - own.position
    cos_own, sin_own = jnp.cos(own.heading), jnp.sin(own.heading)
    turn = other.heading - own.heading  # the sine of the difference is exactly 0 for equal headings
    cos, sin = jnp.cos(turn), jnp.sin(turn)
    return Relative(
        ahead=away[..., 0] * cos_own + away[..., 1] * sin_own,
        left=away[..., 1] * cos_own - away[..., 0] * sin_own,
        reach_along=(own.length + other.length * jnp.abs(cos) + other.width * jnp.abs(sin)) / 2,
        reach_across=(own.width + other.length * jnp.abs(sin) + other.width * jnp.abs(cos)) / 2,
        own_speed=jnp.broadcast_to(own.speed, cos.shape),
        speed_along=other.speed * cos,
        speed_across=other.speed * sin,
        valid=own.valid & other.valid,
    )
