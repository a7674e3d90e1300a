"""The CommonRoad cost function WX1 (Althoff et al., 2017, after Xu et al.); less is better.

Weights and partial costs are those of the package `commonroad-drivability-checker` 2025.4.0, sums by Simpson's rule as
`scipy.integrate.simpson` has it:

| partial cost | weight | what |
|---|---|---|
| T, time | 10 | s, the drive lasts |
| V, velocity offset | 1 | integral of (goal speed - speed)^2; 0 without a goal speed, and no case here has one |
| A, acceleration | 0.1 | integral of the square of differences of the speed |
| J, jerk | 0.1 | integral of the square of second differences of the speed |
| D, distance to obstacles | 0.1 | integral of exp(-0.2 d), d to the closest one ahead in the lane |
| L, path length | 10 | integral of the speed |

In some copies of that package L is the offset from the lane's centre; in the release named it is the path length.
Distances are from centre to centre less width / 2.5, among those ahead by less than 2.8 m aside. There they are along
the lane, here along its direction at the ego, so they differ in curves; and there only those within a window of 100 m
to each side count, here all: exp(-20) is nothing.
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int

from urbanjax.evaluation.facts import Facts
from urbanjax.evaluation.metrics import HARD
from urbanjax.numerics import safe, soft
from urbanjax.numerics.soft import Relaxation
from urbanjax.types import pytree

LANE_SCALE = 0.3  # m, natural scale of being in the lane for the relaxation
AHEAD_SCALE = 1.0  # m, of being ahead


@pytree
class CommonRoadParams:
    """Weights and what the distance to obstacles is made of."""

    time: float = 10.0
    velocity_offset: float = 1.0
    acceleration: float = 0.1
    jerk: float = 0.1
    obstacles: float = 0.1
    length: float = 10.0
    decay: float = 0.2  # 1/m
    aside: float = 2.8  # m, between centres, from which on somebody is not in the lane
    radius: float = 1 / 2.5  # of the ego, in widths


@pytree
class CommonRoadCost:
    """The cost and its partial costs, not weighted."""

    total: Array  # [] their weighted sum
    time: Array  # [] s
    velocity_offset: Array  # [] m^2/s, 0
    acceleration: Array  # [] m^2/s^3
    jerk: Array  # [] m^2/s^5
    obstacles: Array  # [] s
    length: Array  # [] m


def cost(facts: Facts, *, params: CommonRoadParams | None = None, relaxation: Relaxation = HARD) -> CommonRoadCost:
    """The cost WX1 of one drive; see the table above.

    In mode soft others are in the lane and ahead by degrees. Args: facts, of one drive; params, weights and scales;
    relaxation, hard or how soft.
    """
    params = CommonRoadParams() if params is None else params
    n = jnp.sum(facts.alive)
    speed, duration = facts.ego.speed, facts.duration - facts.time[0]
    period = jnp.where(n > 1, duration, 1) / jnp.maximum(n - 1, 1)
    acceleration = (speed[1:] - speed[:-1]) / period
    jerk = (acceleration[1:] - acceleration[:-1]) / period
    parts = {
        "time": duration,
        "velocity_offset": jnp.zeros_like(duration),
        "acceleration": _simpson(acceleration**2, n - 1) * period,
        "jerk": _simpson(jerk**2, n - 2) * period,
        "obstacles": _simpson(_closeness(facts, params, relaxation), n) * period,
        "length": _simpson(speed, n) * period,
    }
    total = sum((getattr(params, name) * part for name, part in parts.items()), jnp.zeros_like(duration))
    return CommonRoadCost(total=total, **parts)


def _closeness(facts: Facts, params: CommonRoadParams, relaxation: Relaxation) -> Float[Array, " t"]:
    """exp(-decay * way along the lane) to the closest one ahead in it, 0 without one."""
    ego, others = facts.ego, facts.others
    road = ego.heading - facts.heading_error
    cos, sin = jnp.cos(road)[:, None], jnp.sin(road)[:, None]
    dx, dy = (others.position[..., i] - ego.position[:, None, i] for i in range(2))
    ahead, aside = dx * cos + dy * sin, dy * cos - dx * sin
    in_lane = soft.above(-jnp.abs(aside), -params.aside, relaxation, scale=LANE_SCALE)
    counts = soft.both(in_lane, soft.above(ahead, 0.0, relaxation, scale=AHEAD_SCALE))
    way = jnp.maximum(ahead, 0) - params.radius * ego.width[:, None]
    return safe.maximum(jnp.where(others.valid, counts * jnp.exp(-params.decay * way), 0), 1)


def _simpson(values: Float[Array, " t"], n: Int[Array, ""]) -> Float[Array, ""]:
    """Integral of the first n values at unit spacing; an even number ends in a parabola through the last three."""
    at = jnp.arange(values.shape[0])
    last = jnp.where(n % 2 == 1, n - 1, n - 2)  # of the points that Simpson's rule takes
    inner = jnp.where(at % 2 == 1, 4.0, 2.0)
    weight = jnp.where((at == 0) | (at == last), 1.0, inner) / 3
    weight = jnp.where((at <= last) & (last > 0), weight, 0)
    tail = jnp.where(at == n - 1, 5 / 12, jnp.where(at == n - 2, 2 / 3, jnp.where(at == n - 3, -1 / 12, 0)))
    weight = weight + jnp.where((n % 2 == 0) & (n > 2), tail, 0)
    weight = jnp.where(n == 2, jnp.where(at < 2, 0.5, 0), weight)
    return jnp.sum(jnp.where(at < n, weight * jnp.where(at < n, values, 0), 0))
