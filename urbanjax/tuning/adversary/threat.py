"""How near a drive came to a collision at the ego's fault, as one smooth number: what searches for failures descend.

The smallest distance of the ego's front bumper from the other one, at the speed at which it shrinks carried on for a
moment, while the ego moves, up to the first touch. Where that is the other one's fault a price stands instead, and how
far the bumper was from being what touched: nobody finds failures by having others run into the ego.
"""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.evaluation import fault
from urbanjax.evaluation.facts import Facts
from urbanjax.geometry.boxes import relaxed_box_gap
from urbanjax.numerics import safe, soft
from urbanjax.numerics.soft import Relaxation
from urbanjax.types import POSITIVE, field, pytree
from urbanjax.vehicle.params import VehicleParams

FAR = 50.0  # m, what stands in for the distance of somebody who is not there


@pytree
class ThreatParams:
    """What counts as near, and what a touch costs that is not the ego's fault."""

    temperature: float = field(default=0.3, metadata=POSITIVE)  # m, of the minimum over steps and road users
    anticipation: float = 0.5  # s, for which the closing goes on: standing close behind somebody is no threat
    standing: float = 10.0  # m, that is added while the ego stands, for nothing is its fault then
    blame: float = 5.0  # m, that a touch adds which is the other one's fault


def threat(facts: Facts, vehicle: VehicleParams, *, params: ThreatParams | None = None) -> Float[Array, ""]:
    """The threat of one drive [m]; below about 0 the ego runs into somebody.

    Smooth, whatever mode drove, but for who is touched first, and when.

    Args: facts [T], of one drive; vehicle, the ego's dimensions; params, scales and weights.
    """
    params = ThreatParams() if params is None else params
    relaxation = Relaxation(params.temperature, mode="soft")
    own, theirs = fault.boxes(facts)
    gaps = relaxed_box_gap(fault.front_bumper(own), theirs, relaxation=relaxation)
    step = (facts.time[1:] - facts.time[:-1])[:, None]
    closing = jnp.minimum((gaps[1:] - gaps[:-1]) / step, 0.0)
    stands = soft.negate(soft.above(facts.ego.speed[1:], fault.SPEED_SCALE, relaxation))[:, None]
    near = gaps[1:] + params.anticipation * closing + params.standing * stands
    touched = jnp.cumsum(jnp.any(facts.first_touch, axis=1))
    before = touched[:-1] == 0  # what comes after a touch, of boxes that pass through each other, tells nothing
    there = facts.others.valid[1:] & (facts.alive[1:] & before)[:, None]
    least = soft.minimum(near.reshape(-1), relaxation, mask=there.reshape(-1), fill=FAR)
    faults = fault.at_fault(facts, vehicle)
    theirs_alone = jax.lax.stop_gradient(faults.begins - faults.at_fault) * (touched == 1)[:, None]
    price = params.blame + jnp.maximum(gaps, 0.0)  # the front bumper was that far from being the first to touch
    return jnp.where(jnp.any(theirs_alone > 0), safe.maximum((theirs_alone * price).reshape(-1)), least)
