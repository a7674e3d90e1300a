"""Which limits the candidates of a fan break."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jaxtyping import Bool, Float

from urbanjax.geometry.boxes import Box, box_gap
from urbanjax.numerics.once import once
from urbanjax.planning.clearance import predicted_boxes
from urbanjax.planning.frenet_sampling.fan import FIELDS, FrenetFan
from urbanjax.planning.frenet_sampling.motion import EndGrid
from urbanjax.types import Prediction, pytree
from urbanjax.vehicle.params import VehicleParams

FRENET_LIMITS = ("curvature", "curvature_rate", "acceleration", "yaw_rate", "reverse", "reference", "collision")
ANGLE_ROUNDING = 1e-5  # rad/s
SPEED_ROUNDING = 1e-3  # m/s


@pytree
class FrenetLimits:
    """What the vehicle's geometry does not say already."""

    max_curvature_rate: float = 0.4  # 1/(m s)
    max_acceleration: float = 6.0  # m/s^2, forward up to `switching_speed`, and of braking
    switching_speed: float = 7.3  # m/s, above which the engine's acceleration falls with 1 / v


def broken(
    fan: FrenetFan, prediction: Prediction | None, *, vehicle: VehicleParams, grid: EndGrid, limits: FrenetLimits
) -> Bool[Array, "r d v n"]:
    """Which of FRENET_LIMITS each candidate breaks, [R, D, V * A, N]; a hard question, without a derivative.

    Rates are differences between points. The first and last two points are exempt from the limit on curvature: what the
    vehicle does now no candidate can help, and both ends are straight across the line. Args: fan, of candidates;
    prediction, of everybody else, None if collisions do not count; vehicle; grid, of the fan; limits.
    """
    shape, period = fan.speed.shape[:-1], grid.period
    sharpest = jnp.tan(jnp.asarray(vehicle.max_steering, fan.values.dtype)) / vehicle.wheelbase
    heading, speed, curvature, acceleration = (_points(fan, name) for name in FIELDS[2:])
    turned, next_speed, bent = (
        _points(fan, "heading", 1) - heading,
        _points(fan, "speed", 1),
        _points(fan, "curvature", 1) - curvature,
    )
    weaker = jnp.maximum(speed * (1 / limits.switching_speed), 1)
    excess = jnp.stack(
        [
            jnp.abs(curvature) - sharpest,
            jnp.abs(bent) - limits.max_curvature_rate * period,
            jnp.maximum(acceleration * weaker, -acceleration) - limits.max_acceleration,
            jnp.abs(turned) - period * (sharpest * next_speed + ANGLE_ROUNDING),
        ]
    )
    excess = jnp.where(_counted(shape, grid.n_times)[:, None], excess, -jnp.inf)
    rates = jnp.max(excess.reshape(4, *shape, -1), axis=-1) > 0
    backwards = (jnp.min(fan.along.speed, axis=-1) < -SPEED_ROUNDING)[None]
    hits = (
        jnp.zeros((1, 1, 1), bool) if prediction is None else clearance(fan, prediction, vehicle=vehicle, grid=grid) < 0
    )
    others = [
        jnp.broadcast_to(limit, shape) for limit in (backwards, jnp.any(fan.along.foot.outside, axis=-1)[None], hits)
    ]
    return jnp.concatenate([rates, jnp.stack(others)])


def _points(fan: FrenetFan, field: str, ahead: int = 0) -> Array:
    """One of FIELDS at all points, or at the next ones, [D, V * A * N * T].

    Cut from the array as it lies in memory, which is many times faster than shifting each candidate: what follows a
    candidate's last point is another's first, and does not count.
    """
    count = fan.heading.size
    begin = FIELDS.index(field) * count + ahead
    flat = lax.slice_in_dim(fan.values.reshape(-1), begin, begin + count)
    return flat.reshape(fan.heading.shape[0], -1)


def _counted(shape: tuple[int, ...], n_times: int) -> np.ndarray:
    """Points at which each of the first four limits counts, [4, V * A * N * T] bool."""
    point = np.arange(n_times)
    within, has_next = (point > 1) & (point < n_times - 2), point < n_times - 1
    return np.tile(np.stack([within, has_next, point >= 0, has_next]), (1, shape[1] * shape[2]))


def clearance(
    fan: FrenetFan, prediction: Prediction, *, vehicle: VehicleParams, grid: EndGrid
) -> Float[Array, "d v n"]:
    """Smallest separating-axis gap [D, V * A, N] (m) between the ego's box and any predicted one at the same time.

    Args: fan, of candidates; prediction, of everybody else; vehicle; grid, of the fan.
    """
    time = grid.period * jnp.arange(grid.n_times).astype(fan.values.dtype)
    origin = fan.position[:, 0, 0, 0, 0]
    # Objects lead and candidates follow, [B, D, V * A, N, T], for long inner loops.
    other = predicted_boxes(prediction, time, origin=origin)
    other = jax.tree.map(lambda v: v.T[:, None, None, None], other)
    cos, sin = jnp.cos(fan.heading), jnp.sin(fan.heading)
    x, y = (fan.position[i] - origin[i] + vehicle.centre_offset * d for i, d in enumerate((cos, sin)))
    half = (jnp.asarray(v / 2, cos.dtype) for v in (vehicle.length, vehicle.width))
    ego = Box(*(v[None] for v in once(x, y, cos, sin)), *half)
    valid = prediction.valid[:, None, None, None]
    return jnp.min(jnp.where(valid, jnp.min(box_gap(ego, other), axis=-1), jnp.inf), axis=0)
