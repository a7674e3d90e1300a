"""Caps on the speed that do not come from traffic: limit, curves, stop line."""

from typing import ClassVar

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.behavior.situation import SignalAhead
from urbanjax.numerics import lean, safe, soft
from urbanjax.planning.basis import interpolate
from urbanjax.roadmap.progress import Sample
from urbanjax.types import POSITIVE, Path, field, pytree
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.limits import approach_speed, curve_speed, easy_stop_speed


@pytree
class CapParams:
    """Comfort in curves and before stops."""

    PINNED: ClassVar[dict[str, str]] = {
        "stop_*": "safety: where and how surely it stops at red",
        "reaction_time": "safety: how surely it stops at red",
        "off_road": "safety: of leaving the road",
        "lag": "fact: of control, see 'control.longitudinal.time_constant'",
    }

    lateral_acceleration: float = 2.5  # m/s^2
    curve_deceleration: float = field(default=1.5, metadata=POSITIVE)  # m/s^2, towards slower stretches ahead
    stop_deceleration: float = field(default=2.0, metadata=POSITIVE)  # m/s^2, towards a stop line
    stop_hardest: float = field(default=4.0, metadata=POSITIVE)  # m/s^2, with which one who rolls on could still stop
    off_road: float = field(default=0.3, metadata=POSITIVE)  # m, by which the body may be off the road
    lag: float = 0.6  # s, in which control follows the speed asked for
    stop_margin: float = 1.5  # m, before the stop line
    reaction_time: float = 0.8  # s, of control: the last metres are rolled out


def along(path: Path, params: CapParams, *, speed_limit: Float[Array, "k"]) -> Float[Array, "k"]:
    """Speed limit and curve speed [K] m/s along a path. Args: path [K]; speed_limit [K] m/s, there."""
    return curve_speed(path.curvature, params.lateral_acceleration, cap=speed_limit)


def open_road(path: Path, driving: Driving, *, road: Sample, reach: float | Array) -> Float[Array, "k"]:
    """Degree [K] to which there is road under a path as far as the vehicle reaches ahead; 0 stays 0.

    So nobody drives on beyond the end of a lane that it has not left. How far the vehicle is off the road already does
    not count. Args: path [K]; driving, with CapParams; road [K], there; reach [m], from a place of the path to what is
    kept free before the end.
    """
    there = road.has_lane
    half = road.lane_width / 2
    right = jnp.min(jnp.where(there, road.lane_offset - half, jnp.inf), axis=1)
    left = jnp.max(jnp.where(there, road.lane_offset + half, -jnp.inf), axis=1)
    right, left = (jnp.where(jnp.isfinite(x), x, 0.0) for x in (right, left))
    wide = driving.vehicle.width / 2
    off = lean.maximum(lean.maximum(right - path.offset, path.offset - left) + wide, 0.0)
    more = off - off[0] - driving.params.off_road
    closed = soft.above(more, 0.0, driving.relaxation, scale=driving.params.off_road)
    station = path.station
    return interpolate(station + reach, station[0], station[1] - station[0], jnp.cumprod(1 - closed))


def stop_before(speed: Float[Array, "*s"], distance: Float[Array, "*s"], *, params: CapParams) -> Float[Array, "*s"]:
    """Speed [*s] m/s to ask for before a stop. Args: speed [*s] m/s, the present one; distance [*s] m, to the stop."""
    return easy_stop_speed(
        speed,
        distance,
        deceleration=params.stop_deceleration,
        reaction_time=params.reaction_time,
        lag=params.lag,
    )


def now(
    path: Path, params: CapParams, *, cap: Float[Array, "k"], signal: SignalAhead, speed: Float[Array, ""]
) -> Float[Array, ""]:
    """Highest speed now [] m/s, from which every cap ahead and a red stop line can be met.

    Args: path [K]; cap [K] m/s, along it; signal, the next one; speed [] m/s, the present one.
    """
    curves = safe.minimum(approach_speed(path.station - path.station[0], cap, deceleration=params.curve_deceleration))
    stop = stop_before(speed, signal.distance - params.stop_margin, params=params)
    return jnp.minimum(curves, jnp.where(signal.red > 0.5, stop, curves))
