"""Whose fault a collision is: what touched what first, as nuPlan's metrics tell it.

| contact | when | at fault |
|---|---|---|
| NONE | nothing touches the ego | - |
| STANDING | the ego stands still | no |
| REAR | the other one touches the ego's rear bumper, and not its front, while it is the faster | no |
| STANDING_OTHER | the other one stands still | yes |
| FRONT | the ego's front bumper touches the other one | yes |
| SIDE | anything else: the ego's flank, or its rear bumper while it is the faster | yes |

nuPlan excuses the ego for a SIDE contact while it is within one lane; here it is always at fault.
"""

import enum

import jax.numpy as jnp
from jax import Array

from urbanjax.geometry.boxes import Box, box, box_gap
from urbanjax.sim.log import Log
from urbanjax.types import pytree
from urbanjax.vehicle.params import VehicleParams

STILL = 0.1  # m/s
BUMPER = 0.3  # m, depth of the strip that counts as a bumper


class Contact(enum.IntEnum):
    """What touched what; the order is that of the questions asked."""

    NONE = 0
    STANDING = 1
    STANDING_OTHER = 2
    FRONT = 3
    REAR = 4
    SIDE = 5


AT_FAULT = (Contact.STANDING_OTHER, Contact.FRONT, Contact.SIDE)


@pytree
class Collision:
    """The first contact of a run."""

    contact: Array  # [] int32, a Contact
    at_fault: Array  # [] bool
    step: Array  # [] int32, when; T without one
    other: Array  # [] int32, with whom


def first(log: Log, vehicle: VehicleParams) -> Collision:
    """The first contact of the ego with anybody in a log of T steps; see the table above. Hard.

    Args: log, of one run; vehicle, the ego's dimensions.
    """
    traffic, ego = log.traffic, log.ego
    others = box(traffic.position, traffic.heading, length=traffic.length, width=traffic.width)
    size = jnp.ones_like(ego.heading)[:, None]

    def strip(along: float | Array, length: float | Array) -> Box:
        """A part of the ego's box, `along` m before its centre."""
        forward = jnp.stack([jnp.cos(ego.heading), jnp.sin(ego.heading)], axis=-1)
        centre = log.centre + along * forward
        return box(centre[:, None, :], ego.heading[:, None], length=length * size, width=vehicle.width * size)

    touches = (box_gap(strip(0.0, vehicle.length), others) <= 0) & traffic.valid
    reach = (vehicle.length - BUMPER) / 2
    front, rear = (box_gap(strip(side * reach, BUMPER), others) <= 0 for side in (1, -1))
    any_touch = jnp.any(touches, axis=1)
    step = jnp.argmax(any_touch).astype(jnp.int32)
    other = jnp.argmax(touches[step]).astype(jnp.int32)
    along = traffic.speed[step, other] * jnp.cos(traffic.heading[step, other] - ego.heading[step])
    cases = (
        (~any_touch[step], Contact.NONE),
        (ego.speed[step] < STILL, Contact.STANDING),
        (traffic.speed[step, other] < STILL, Contact.STANDING_OTHER),
        (front[step, other], Contact.FRONT),
        (rear[step, other] & (along > ego.speed[step]), Contact.REAR),
        (jnp.asarray(True), Contact.SIDE),
    )
    conditions, kinds = zip(*cases, strict=True)
    contact = jnp.asarray(kinds, jnp.int32)[jnp.argmax(jnp.stack(conditions))]
    at_fault = jnp.isin(contact, jnp.asarray(AT_FAULT, jnp.int32))
    return Collision(contact, at_fault, jnp.where(any_touch[step], step, log.time.shape[0]).astype(jnp.int32), other)
