"""What a drive is to reach where a station of its route does not say it all: a place, a time, a speed, a heading."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.types import pytree

ROUNDING = 1e-3  # s, m/s or rad, by which a bound may be missed


@pytree
class Aim:
    """G goals, any of which may be reached; the place of each is any of K outlines of M corners."""

    outline: Array  # [G, K, M, 2] m, corners in order; what is missing repeats the last one
    anywhere: Array  # [G] bool, whether no place is asked for
    time: Array  # [G, 2] s of the world's clock, from and to; infinite where nothing is asked, and so are speeds
    speed: Array  # [G, 2] m/s
    heading: Array  # [G, 2] rad, from where on, and how far to the left


def arrived(
    aim: Aim,
    *,
    time: Float[Array, " t"],
    position: Float[Array, "t 2"],
    heading: Float[Array, " t"],
    speed: Float[Array, " t"],
) -> Bool[Array, " t"]:
    """In which steps some goal holds, in all that it names.

    Args: aim; time [T] s of the world's clock; position [T, 2] m, of the box centre; heading [T] rad; speed [T] m/s.
    """

    def within(values: Array, bounds: Array) -> Array:
        at = values[:, None]
        return (at >= bounds[None, :, 0] - ROUNDING) & (at <= bounds[None, :, 1] + ROUNDING)

    turned = jnp.mod(heading[:, None] - aim.heading[None, :, 0] + ROUNDING, 2 * jnp.pi)
    holds = within(time, aim.time) & within(speed, aim.speed) & (turned <= aim.heading[None, :, 1] + 2 * ROUNDING)
    return jnp.any(holds & (aim.anywhere[None] | inside(aim, position)), axis=1)


def inside(aim: Aim, position: Float[Array, "t 2"]) -> Bool[Array, "t g"]:
    """Which positions lie in the place of each goal: a ray from there crosses an outline an odd number of times.

    Args: aim; position [T, 2] m.
    """
    start, end = aim.outline[None], jnp.roll(aim.outline, -1, axis=2)[None]
    x, y = position[:, 0, None, None, None], position[:, 1, None, None, None]
    spans = (start[..., 1] > y) != (end[..., 1] > y)
    rise = jnp.where(end[..., 1] == start[..., 1], 1, end[..., 1] - start[..., 1])
    crossing = start[..., 0] + (y - start[..., 1]) * (end[..., 0] - start[..., 0]) / rise
    return jnp.any(jnp.sum(spans & (x < crossing), axis=-1) % 2 == 1, axis=-1)
