"""Whose fault a collision is by nuPlan's rule: one rule for all scores that ask.

Asked at the first touch with each other road user, in this order:

| the case | at fault |
|---|---|
| the ego stands | no |
| the other one stands | yes |
| its centre lies behind the ego's rear axle, more than 150 degrees off the heading | no |
| the ego's front bumper touches it | yes |
| anything else (a side) | unless the ego was within one lane |

Standing asks for the magnitude of the speed. In mode soft every choice but the last is a degree; what lane the ego is
in stays yes or no.
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.evaluation.facts import Facts
from urbanjax.evaluation.metrics import HARD
from urbanjax.geometry.boxes import Box, box, overlap, relaxed_box_gap
from urbanjax.numerics import safe, soft
from urbanjax.numerics.soft import Relaxation
from urbanjax.types import pytree
from urbanjax.vehicle.params import VehicleParams

SPEED_SCALE = 0.1  # m/s, natural scale of "stands" for the relaxation
BEARING_SCALE = 0.1  # natural scale of the cosine of a bearing
TOUCH_SCALE = 1.0  # m, natural scale of gaps


@pytree
class FaultRule:
    """Thresholds of the rule, as nuPlan has them."""

    still: float = 0.05  # m/s, at or below which somebody stands
    behind: float = 150.0  # deg off the heading, above which somebody is behind


@pytree
class Faults:
    """Touches of a drive by step and other road user."""

    begins: Array  # [T, V] degree to which the two touch for the first time
    at_fault: Array  # [T, V] degree to which they do, and it is the ego's fault
    apart: Array  # [T, V] degree to which they have not touched so far, this step included


def at_fault(
    facts: Facts, vehicle: VehicleParams, *, params: FaultRule | None = None, relaxation: Relaxation = HARD
) -> Faults:
    """First touches and whose fault they are, as degrees; 0 or 1 in mode hard.

    Args: facts, of one drive; vehicle, the ego's dimensions; params, thresholds; relaxation, hard or how soft.
    """
    params = FaultRule() if params is None else params
    ego, others = facts.ego, facts.others
    own, theirs = boxes(facts)
    begins = first_touches(facts, relaxation=relaxation)
    there = others.valid & facts.alive[:, None]
    apart = soft.combine(
        lambda: (jnp.cumsum(facts.first_touch, axis=0) == 0).astype(own.x.dtype),
        lambda: jnp.cumprod(1 - jnp.where(there, touch(own, theirs, relaxation=relaxation), 0), axis=0),
        relaxation=relaxation,
    )
    moves = soft.above(jnp.abs(ego.speed), params.still, relaxation, scale=SPEED_SCALE)[:, None]
    other_moves = soft.above(jnp.abs(others.speed), params.still, relaxation, scale=SPEED_SCALE)
    behind = further_than(bearing(facts, vehicle), params.behind, relaxation=relaxation)
    front = touch(front_bumper(own), theirs, relaxation=relaxation)
    side = (~facts.in_one_lane[:, None]).astype(front.dtype)
    active = soft.both(soft.negate(behind), soft.either(front, side))
    fault = soft.both(moves, soft.either(soft.negate(other_moves), active))
    return Faults(begins, begins * fault, apart)


def front_bumper(own: Box) -> Box:
    """The front edge of a box, as a box of no length. Args: own, the ego's."""
    return Box(
        own.x + own.half_length * own.cos,
        own.y + own.half_length * own.sin,
        own.cos,
        own.sin,
        jnp.zeros_like(own.half_length),
        own.half_width,
    )


def first_touches(facts: Facts, *, relaxation: Relaxation) -> Float[Array, "t v"]:
    """Degree to which the ego and each other road user touch for the first time in each step.

    Args: facts, of one drive; relaxation, hard or how soft.
    """
    own, theirs = boxes(facts)
    there = facts.others.valid & facts.alive[:, None]
    return soft.combine(
        lambda: facts.first_touch.astype(own.x.dtype),
        lambda: _first(jnp.where(there, touch(own, theirs, relaxation=relaxation), 0)),
        relaxation=relaxation,
    )


def boxes(facts: Facts) -> tuple[Box, Box]:
    """The ego's box [T, 1] and the others' [T, V]. Args: facts, of one drive."""
    ego, others = facts.ego, facts.others
    own = box(ego.position[:, None], ego.heading[:, None], length=ego.length[:, None], width=ego.width[:, None])
    return own, box(others.position, others.heading, length=others.length, width=others.width)


def touch(a: Box, b: Box, *, relaxation: Relaxation) -> Array:
    """Degree to which boxes of broadcastable shapes share a point.

    Args: a, b, boxes; relaxation, hard or how soft.
    """
    smooth = relaxation.replace(mode="soft")
    return soft.combine(
        lambda: overlap(a, b).astype(a.x.dtype),
        lambda: soft.above(
            -relaxed_box_gap(a, b, relaxation=smooth, scale=TOUCH_SCALE), 0.0, smooth, scale=TOUCH_SCALE
        ),
        relaxation=relaxation,
    )


def bearing(facts: Facts, vehicle: VehicleParams) -> Float[Array, "t v"]:
    """Cosine of the angle between the ego's heading and the way from its rear axle to the others' centres.

    Args: facts, of one drive; vehicle, for where its rear axle is.
    """
    ego = facts.ego
    forward = jnp.stack([jnp.cos(ego.heading), jnp.sin(ego.heading)], axis=-1)[:, None]
    away = facts.others.position - ego.position[:, None] + vehicle.centre_offset * forward
    return safe.divide(jnp.sum(away * forward, axis=-1), safe.norm(away))


def further_than(cosine: Float[Array, "*s"], angle: float | Array, *, relaxation: Relaxation) -> Float[Array, "*s"]:
    """Degree to which a bearing is more than an angle off.

    Args: cosine, of the bearing; angle, in degrees; relaxation, hard or how soft.
    """
    return soft.above(-cosine, -jnp.cos(jnp.deg2rad(angle)), relaxation, scale=BEARING_SCALE)


def _first(touching: Float[Array, "t v"]) -> Float[Array, "t v"]:
    """Degree of the first of degrees along the steps."""
    before = jnp.cumprod(1 - touching, axis=0)
    return touching * jnp.concatenate([jnp.ones_like(before[:1]), before[:-1]])
