"""Motions along and across a reference line to every end state of a grid (Werling et al. 2010).

The grid is a product, and so are the motions: s(t) depends on duration and end speed, d(t) on duration and offset.
Both are small tables; only their combination in the plane has the size of the fan.
"""

from typing import Any

import jax.numpy as jnp
from jax import Array

from urbanjax.numerics import polynomial
from urbanjax.numerics.once import once
from urbanjax.planning.frenet_sampling.line import LineFoot, ReferenceLine, look_up
from urbanjax.types import POSITIVE, field, pytree, static

HEADINGS = ("exact", "slope")  # tan of the heading against the reference: d' / (1 - kappa d), or d' alone
LATERALS = ("time", "station")  # what the lateral offset is a quintic of; at low speed of the station
MIN_RATE = 1e-3  # m/s along the reference, below which a motion over time has no direction
MIN_REACH = 1e-2  # m, in which a quintic over the station ends at the least


@pytree
class EndGrid:
    """The end states that are tried: every offset with every speed, acceleration and duration."""

    offsets: Any = (-3.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 3.0)  # [D] m, left of the reference line
    speeds: Any = (0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 14.0)  # [V] m/s along it
    accelerations: Any = (0.0,)  # [A] m/s^2
    # [N] s; afterwards the speed holds and the offset stays
    durations: Any = field(default=(1.0, 2.0, 3.0), metadata=POSITIVE)
    period: float = field(default=0.1, metadata=POSITIVE)  # s, between two points
    n_times: int = static(default=31)  # T
    lateral: str = static(default="time", metadata={"choices": LATERALS})
    heading: str = static(default="exact", metadata={"choices": HEADINGS})


@pytree
class FrenetState:
    """Where a fan begins."""

    station: Array  # [3] m, m/s, m/s^2, along the reference line
    offset: Array  # [3] m, m/s, m/s^2, left of it


@pytree
class Along:
    """Motion along the reference line: all [V * A, N, T]."""

    station: Array  # m
    speed: Array  # m/s
    acceleration: Array  # m/s^2
    foot: LineFoot  # the line there
    reach: Array  # [V * A, N] m, covered at the end of the duration
    jerk: tuple[Array, Array]  # [V * A, N] m/s^3 at the start, and m/s^4


@pytree
class Across:
    """Motion across the reference line: [D, V * A, N, T], or with 1 for V * A where it does not depend on that."""

    offset: Array  # m
    first: Array  # m/s, or over the station 1
    second: Array  # m/s^2, or 1/m
    length: Array  # [1, V * A or 1, N] s, or m, that the motion takes
    jerk: tuple[Array, Array, Array]  # m/s^3 at the start, m/s^4, m/s^5 (over the station per m)


def along(line: ReferenceLine, start: Array, *, grid: EndGrid) -> Along:
    """The quartics s(t) to each end speed and acceleration, whatever the station there.

    Args: line, the reference; start [3] m, m/s, m/s^2, along it; grid, of end states.
    """
    within, past, ended, durations = _times(grid, line.rows.dtype)
    speeds, accelerations = (jnp.asarray(v, line.rows.dtype) for v in (grid.speeds, grid.accelerations))
    end_speed = jnp.repeat(speeds, accelerations.shape[0])[:, None]
    coefficients = _quartic(start, end_speed, jnp.tile(accelerations, speeds.shape[0])[:, None], durations[None])
    shape = (*coefficients[0].shape, within.shape[-1])
    station, speed, acceleration = _evaluate(coefficients, jnp.broadcast_to(within[None], shape))
    reach = polynomial.evaluate(coefficients, jnp.broadcast_to(durations[None], shape[:2]))[0] - start[0]
    station = station + past[None] * end_speed[..., None]
    acceleration = jnp.where(ended[None], 0, acceleration)
    foot = look_up(line, station)
    here = (foot.x, foot.y, foot.heading, foot.cos, foot.sin, foot.curvature, foot.curvature_slope)
    station, speed, acceleration, *here = once(station, speed, acceleration, *here)
    jerk = (6 * coefficients[3], 24 * coefficients[4])
    return Along(station, speed, acceleration, LineFoot(*here, outside=foot.outside), reach=reach, jerk=jerk)


def across(motion: Along, start: Array, *, grid: EndGrid) -> Across:
    """The quintics d to each offset, over time or over the way covered.

    Args: motion, along the line; start [3] m, m/s, m/s^2, left of it; grid, of end states.
    """
    within, _, ended, durations = _times(grid, motion.station.dtype)
    if grid.lateral == "time":
        state, reach, variable = start, durations[None, None], within[None, None]
    else:
        state = _over_station(start, motion.speed[0, 0, 0], motion.acceleration[0, 0, 0])
        reach = jnp.maximum(motion.reach, MIN_REACH)[None]
        variable = jnp.clip((motion.station - motion.station[:, :, :1])[None], 0, reach[..., None])
    offsets = jnp.asarray(grid.offsets, motion.station.dtype)[:, None, None]
    shape = jnp.broadcast_shapes(offsets.shape, reach.shape)
    d0, v0, a0, end, duration = (jnp.broadcast_to(v, shape) for v in (*state, offsets, reach))
    zero = jnp.zeros_like(end)
    coefficients = tuple(once(*polynomial.quintic((d0, v0, a0), (end, zero, zero), duration=duration)))
    wide = jnp.broadcast_shapes((*shape, 1), variable.shape)
    offset, slope, bend = _evaluate(coefficients, jnp.broadcast_to(variable, wide))
    ended = jnp.broadcast_to(ended, wide)
    table = once(offset, jnp.where(ended, 0, slope), jnp.where(ended, 0, bend))
    return Across(*table, length=reach, jerk=(6 * coefficients[3], 24 * coefficients[4], 60 * coefficients[5]))


def per_way(speed: Array) -> Array:
    """1 / speed (s/m), and 0 where that is too slow to have a direction. Args: speed m/s."""
    moving = speed > MIN_RATE
    return jnp.where(moving, 1 / jnp.where(moving, speed, 1), 0)


def _over_station(start: Array, speed: Array, acceleration: Array) -> tuple[Array, Array, Array]:
    """Offset (m) with its derivatives over the station (1 and 1/m), of those over time."""
    rate = per_way(speed)
    slope = start[1] * rate
    return start[0], slope, (start[2] - slope * acceleration) * rate * rate


def _quartic(start: Array, end_speed: Array, end_acceleration: Array, duration: Array) -> tuple[Array, ...]:
    """Coefficients of the quartic from a state [3] to a speed and an acceleration."""
    s0, v0, a0 = start
    change = end_speed - v0 - a0 * duration
    jump = end_acceleration - a0
    third = change / duration**2 - jump / (3 * duration)
    fourth = jump / (4 * duration**2) - change / (2 * duration**3)
    return tuple(once(*(jnp.broadcast_to(c, third.shape) for c in (s0, v0, a0 / 2)), third, fourth))


def _evaluate(coefficients: tuple[Array, ...], variable: Array) -> tuple[Array, Array, Array]:
    return polynomial.evaluate(tuple(jnp.broadcast_to(c[..., None], variable.shape) for c in coefficients), variable)


def _times(grid: EndGrid, dtype: Any) -> tuple[Array, Array, Array, Array]:
    """Times up to each duration [N, T], time past it, whether it has ended, and the durations [N]."""
    durations = jnp.asarray(grid.durations, dtype)
    time = jnp.asarray(grid.period, dtype) * jnp.arange(grid.n_times).astype(dtype)
    past = time[None] - durations[:, None]
    ended = past > 1e-3 * grid.period  # a point that rounding puts beside the duration has not
    return jnp.minimum(time[None], durations[:, None]), jnp.maximum(past, 0), ended, durations
