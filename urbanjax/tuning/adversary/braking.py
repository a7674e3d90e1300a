"""Whether braking in full would have avoided a collision: the oracle that tells failures from fate.

The ego keeps to the way that it drove, so that a drive once logged is all that is needed: along it, braking in full
from any step on is known in closed form. That holds as long as others do not react to the ego, as in encounters.
"""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.evaluation.case import Case
from urbanjax.evaluation.facts import facts
from urbanjax.evaluation.fault import at_fault
from urbanjax.sim.log import Log
from urbanjax.types import pytree
from urbanjax.vehicle.params import VehicleParams

RISE = 1e-5  # m per step


@pytree
class Avoidance:
    """What braking in full comes to."""

    avoidable: Array  # [] bool, from some step between the onset and the collision on it avoids all fault
    latest: Array  # [] s, the last such step; minus infinity if there is none


def braked(log: Log, since: Float[Array, ""], *, vehicle: VehicleParams) -> Log:
    """The drive along the same way, with full braking from a time on, among others who go on as they did.

    Args: log [T], of one run; since [] s, when the braking begins; vehicle, the ego's.
    """
    ego, time = log.ego, log.time
    step = time[1:] - time[:-1]
    held = jnp.interp(since, time, ego.speed)
    slowed = jnp.maximum(held - vehicle.max_deceleration * (time - since), 0.0)
    speed = jnp.where(time <= since, ego.speed, jnp.minimum(slowed, ego.speed))

    def way(speed: Array) -> Array:
        return jnp.concatenate([jnp.zeros_like(step[:1]), jnp.cumsum(0.5 * (speed[1:] + speed[:-1]) * step)])

    # Somebody who stands has one place for many steps: the ever so small rise keeps the way invertible.
    rising = way(ego.speed) + RISE * jnp.arange(len(time), dtype=time.dtype)
    at = way(speed)

    def along(values: Array) -> Array:
        return jnp.interp(at, rising, values)

    moved = ego.replace(
        position=jax.vmap(along, in_axes=1, out_axes=1)(ego.position),
        heading=along(ego.heading),
        speed=speed,
        acceleration=jnp.concatenate([(speed[1:] - speed[:-1]) / step, jnp.zeros_like(step[:1])]),
        steering=along(ego.steering),
    )
    centre = jax.vmap(along, in_axes=1, out_axes=1)(log.centre)
    return log.replace(ego=moved, centre=centre, offset=along(log.offset))


def avoidance(
    log: Log, case: Case, *, collision: Bool[Array, " t"], onset: Float[Array, ""], vehicle: VehicleParams
) -> Avoidance:
    """Whether braking in full from some step on would have avoided the collision, and from which step at the latest.

    Args: log [T], of one run of the case; case, not stacked; collision [T] bool, steps in which one begins at the ego's
    fault; onset [] s, before which nobody could know; vehicle, the ego's dimensions.
    """

    def avoids(since: Array) -> Array:
        seen = facts(braked(log, since, vehicle=vehicle), case, vehicle=vehicle)
        return ~jnp.any(at_fault(seen, vehicle).at_fault > 0)

    when = jnp.min(jnp.where(collision, log.time, jnp.inf))
    # One after the other: a batch of drives is batch enough, and memory stays that of one start of braking.
    free = jax.lax.map(avoids, log.time) & (log.time >= onset) & (log.time <= when)
    return Avoidance(jnp.any(free), jnp.max(jnp.where(free, log.time, -jnp.inf)))
