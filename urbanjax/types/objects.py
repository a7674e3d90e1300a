"""Other road users, as perceived now and as predicted."""

import enum

import jax.numpy as jnp
import jaxlie
from jax import Array

from urbanjax.types.struct import pytree


class RoadUser(enum.IntEnum):
    """What somebody on the road is."""

    VEHICLE = 0
    PEDESTRIAN = 1
    CYCLIST = 2


@pytree
class Objects:
    """Perceived objects, padded to O; the reference point is the centre of the box."""

    position: Array  # [O, 2] m
    heading: Array  # [O] rad
    speed: Array  # [O] m/s, along the heading
    length: Array  # [O] m
    width: Array  # [O] m
    valid: Array  # [O] bool
    kind: Array | None = None  # [O] int32, a RoadUser; None: all are vehicles

    def with_kinds(self) -> "Objects":
        """The same with `kind` filled in."""
        return self if self.kind is not None else self.replace(kind=jnp.zeros(self.valid.shape, jnp.int32))

    def seen_from(self, T_to_from: jaxlie.SE2) -> "Objects":
        """The same in another frame. Args: T_to_from, of the frame that they are in, seen from the other."""
        cos, sin, dx, dy = T_to_from.unit_complex_xy
        x, y = self.position[:, 0], self.position[:, 1]
        position = jnp.stack([cos * x - sin * y + dx, sin * x + cos * y + dy], axis=1)
        return self.replace(position=position, heading=self.heading + T_to_from.rotation().as_radians())


@pytree
class Prediction:
    """Where objects will be: one oriented box per object, branch of the road and time.

    Branches are flattened into the leading axis: B = O * branches.
    """

    position: Array  # [B, H, 2] m, box centre
    heading: Array  # [B, H] rad
    speed: Array  # [B] m/s
    length: Array  # [B] m
    width: Array  # [B] m
    time: Array  # [H] s from now, time[0] = 0
    valid: Array  # [B] bool
