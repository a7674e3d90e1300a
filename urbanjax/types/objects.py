"""Other road users, as perceived now and as predicted."""

from jax import Array

from urbanjax.types.struct import pytree


@pytree
class Objects:
    """Perceived objects, padded to O; the reference point is the centre of the box."""

    position: Array  # [O, 2] m
    heading: Array  # [O] rad
    speed: Array  # [O] m/s, along the heading
    length: Array  # [O] m
    width: Array  # [O] m
    valid: Array  # [O] bool


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
