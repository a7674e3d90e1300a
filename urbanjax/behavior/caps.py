"""Caps on the speed that do not come from traffic: limit, curves, stop line."""

from typing import ClassVar

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.behavior.situation import SignalAhead
from urbanjax.numerics import safe
from urbanjax.types import POSITIVE, Path, field, pytree
from urbanjax.vehicle.limits import approach_speed, curve_speed, stop_speed


@pytree
class CapParams:
    """Comfort in curves and before stops."""

    PINNED: ClassVar[dict[str, str]] = {
        "stop_*": "safety: where and how surely it stops at red",
        "reaction_time": "safety: how surely it stops at red",
    }

    lateral_acceleration: float = 2.5  # m/s^2
    curve_deceleration: float = field(default=1.5, metadata=POSITIVE)  # m/s^2, towards slower stretches ahead
    stop_deceleration: float = field(default=2.5, metadata=POSITIVE)  # m/s^2, towards a stop line
    stop_margin: float = 1.5  # m, before the stop line
    reaction_time: float = 0.3  # s


def along(path: Path, params: CapParams, *, speed_limit: Float[Array, "k"]) -> Float[Array, "k"]:
    """Speed limit and curve speed [K] m/s along a path. Args: path [K]; speed_limit [K] m/s, there."""
    return curve_speed(path.curvature, params.lateral_acceleration, cap=speed_limit)


def now(path: Path, params: CapParams, *, cap: Float[Array, "k"], signal: SignalAhead) -> Float[Array, ""]:
    """Highest speed now [] m/s, from which every cap ahead and a red stop line can be met.

    Args: path [K]; cap [K] m/s, along it; signal, the next one.
    """
    curves = safe.minimum(approach_speed(path.station - path.station[0], cap, deceleration=params.curve_deceleration))
    stop = stop_speed(
        signal.distance - params.stop_margin, params.stop_deceleration, reaction_time=params.reaction_time
    )
    return jnp.minimum(curves, jnp.where(signal.red > 0.5, stop, curves))
