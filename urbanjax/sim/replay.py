"""Recorded road users that move as they did, whatever the ego does."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import safe
from urbanjax.types import Objects, pytree

ROUNDING = 1e-3  # of a period: a time just before a record counts as that of the record


@pytree
class Replay:
    """V recorded road users at T times, `period` apart from time 0 on; the reference point is the box centre."""

    position: Array  # [T, V, 2] m
    heading: Array  # [T, V] rad
    speed: Array  # [T, V] m/s
    length: Array  # [V] m
    width: Array  # [V] m
    valid: Array  # [T, V] bool
    period: Array  # [] s
    kind: Array | None = None  # [V] int32, a RoadUser; None: all are vehicles


def objects(replay: Replay, time: Float[Array, ""]) -> Objects:
    """The road users at `time` s, linear between two records; after the last one there are none.

    Args: replay, the records; time [] s.
    """
    last = replay.heading.shape[0] - 1
    steps = jnp.maximum(time / replay.period, 0)
    before = jnp.clip(jnp.floor(steps + ROUNDING).astype(jnp.int32), 0, last)
    after = jnp.minimum(before + 1, last)
    share = jnp.clip(steps - before, 0, 1)

    def between(values: Array) -> Array:
        return values[before] + share * (values[after] - values[before])

    turned = safe.wrap_angle(replay.heading[after] - replay.heading[before])
    # Somebody who is recorded only before stands there until the next record: nobody is anywhere halfway.
    held = ~replay.valid[after]
    position = jnp.where(held[:, None], replay.position[before], between(replay.position))
    return Objects(
        position=position,
        heading=replay.heading[before] + jnp.where(held, 0, share * turned),
        speed=jnp.where(held, replay.speed[before], between(replay.speed)),
        length=replay.length,
        width=replay.width,
        valid=replay.valid[before] & (steps < last + 0.5),  # the last record holds for half a period
        kind=replay.kind,
    )
