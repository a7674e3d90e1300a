"""Lateral control by pure pursuit on the rear axle."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import lean, polynomial, safe
from urbanjax.types import Path, VehicleState, pytree
from urbanjax.vehicle.driving import Driving


@pytree
class PurePursuitParams:
    """Look-ahead distance l_d = clip(gain * speed, minimum, maximum)."""

    gain: float = 0.7  # s
    minimum: float = 4.0  # m
    maximum: float = 25.0  # m


def look_ahead(path: Path, distance: Float[Array, ""]) -> Float[Array, "2"]:
    """The point [2] m of a path at a way along it, by the cubic Hermite curve of its positions and headings.

    A chord of three metres would ask for a sixth more curvature than a ring of 12 m has. Straight on beyond the end.
    Args: path; distance [] m, from its start.
    """
    chords = safe.norm(jnp.diff(path.position, axis=0))
    way = lean.running_sum(chords)
    index = lean.clip(jnp.sum(way <= distance) - 1, 0, chords.shape[0] - 1)
    ends = jnp.stack([index, index + 1])
    step, (start, end) = lean.rows(chords, index), lean.rows(path.position, ends)
    share = safe.divide(distance - lean.rows(way, index), step)
    inside = lean.clip(share, 0.0, 1.0)
    angle = lean.rows(path.heading, ends)
    out, back = step * jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)
    weights = polynomial.hermite(inside)
    return weights[0] * start + weights[1] * end + weights[2] * out + weights[3] * back + (share - inside) * back


def steer(path: Path, driving: Driving, *, state: VehicleState) -> Float[Array, ""]:
    """Road-wheel angle delta = atan(2 L sin(alpha) / l_d), in radians (section IV-E, control).

    alpha is the bearing of the look-ahead point seen from the rear axle and l_d its true distance, so the arc
    passes through the point. Not differentiable at the two ends of the look-ahead clip. Args: path; driving, with
    PurePursuitParams; state, of the ego.
    """
    params, vehicle = driving.params, driving.vehicle
    distance = lean.clip(params.gain * state.speed, params.minimum, params.maximum)
    to_point = look_ahead(path, distance) - state.position
    x, y = jnp.unstack(to_point)
    lateral = y * jnp.cos(state.heading) - x * jnp.sin(state.heading)
    squared = jnp.maximum(x * x + y * y, params.minimum**2 / 4)
    return lean.clip(jnp.arctan(2 * vehicle.wheelbase * lateral / squared), -vehicle.max_steering, vehicle.max_steering)
