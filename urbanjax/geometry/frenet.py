"""The Frenet frame of a reference line that is tabulated at uniform stations, and curves offset from it.

Between two stations the position is the cubic Hermite curve of the positions and headings (continuous with its
tangent); heading and curvature are linear. Queries may have any shape.
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int

from urbanjax.numerics import safe
from urbanjax.types import pytree


@pytree
class Reference:
    """The reference line at some stations."""

    position: Array  # [*q, 2] m
    heading: Array  # [*q] rad
    curvature: Array  # [*q] 1/m


def cell(
    start: float | Float[Array, ""], spacing: float | Float[Array, ""], n: int, station: Float[Array, "*q"]
) -> tuple[Int[Array, "*q"], Float[Array, "*q"], Float[Array, "*q"]]:
    """Interval of the grid at each station (0 to n - 2), fraction within it (0 to 1), and metres beyond an end, signed.

    Args: start, first station [m]; spacing [m]; n, number of grid stations; station [m].
    """
    steps = (station - start) / spacing
    inside = jnp.clip(steps, 0, n - 1)
    index = jnp.clip(jnp.floor(inside).astype(int), 0, n - 2)
    return index, inside - index, (steps - inside) * spacing


def linear(values: Float[Array, "n *c"], index: Int[Array, "*q"], fraction: Float[Array, "*q"]) -> Float[Array, "..."]:
    """Values [*q, *c] between grid rows index and index + 1."""
    weight = fraction.reshape(fraction.shape + (1,) * (values.ndim - 1))
    return values[index] * (1 - weight) + values[index + 1] * weight


def hermite(
    position: Float[Array, "n 2"],
    heading: Float[Array, "n"],
    spacing: float,
    index: Int[Array, "*q"],
    fraction: Float[Array, "*q"],
) -> Float[Array, "*q 2"]:
    """Positions [m] on the cubic Hermite curve between grid rows index and index + 1."""
    f = fraction[..., None]
    angle_0, angle_1 = heading[index], heading[index + 1]
    tangent_0 = spacing * jnp.stack([jnp.cos(angle_0), jnp.sin(angle_0)], axis=-1)
    tangent_1 = spacing * jnp.stack([jnp.cos(angle_1), jnp.sin(angle_1)], axis=-1)
    end = f * f * (3 - 2 * f)
    return (1 - end) * position[index] + end * position[index + 1] + f * (1 - f) * ((1 - f) * tangent_0 - f * tangent_1)


def sample(
    position: Float[Array, "n 2"],
    heading: Float[Array, "n"],
    curvature: Float[Array, "n"],
    start: float | Float[Array, ""],
    spacing: float,
    station: Float[Array, "*q"],
) -> Reference:
    """The reference line at the stations; beyond an end it goes straight on (its curvature fades within one spacing).

    Args: position [m], heading [rad, unwrapped] and curvature [1/m] at stations start + spacing * k [m]; station [m].
    """
    index, fraction, beyond = cell(start, spacing, position.shape[0], station)
    angle = linear(heading, index, fraction)
    on_curve = hermite(position, heading, spacing, index, fraction)
    straight = beyond[..., None] * jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)
    fade = jnp.maximum(1 - jnp.abs(beyond) / spacing, 0)
    return Reference(on_curve + straight, angle, fade * linear(curvature, index, fraction))


def to_world(reference: Reference, offset: Float[Array, "*q"]) -> Float[Array, "*q 2"]:
    """Positions [m] at a lateral offset [m] from the reference line, left positive."""
    normal = jnp.stack([-jnp.sin(reference.heading), jnp.cos(reference.heading)], axis=-1)
    return reference.position + offset[..., None] * normal


def offset_curve(
    heading: Float[Array, "*q"],
    curvature: Float[Array, "*q"],
    offset: Float[Array, "*q"],
    slope: Float[Array, "*q"],
    bend: Float[Array, "*q"],
    curvature_slope: Float[Array, "*q"] | None = None,
    min_scale: float = 0.1,
) -> tuple[Float[Array, "*q"], Float[Array, "*q"]]:
    """Heading [rad] and curvature [1/m] of the curve d(s) beside a reference line (Werling et al. 2010).

        heading = theta_r + atan(d' / (1 - kappa_r d))
        curvature = ((d'' + (kappa_r' d + kappa_r d') tan) cos^2 / (1 - kappa_r d) + kappa_r) cos / (1 - kappa_r d)

    with tan and cos of the heading difference. The frame ends where 1 - kappa_r d reaches 0, the centre of curvature;
    it is held at min_scale, so the result is finite but means nothing beyond (not differentiable at that bound).
    Args: heading [rad] and curvature [1/m] of the reference; offset d [m]; slope d' [-]; bend d'' [1/m];
    curvature_slope kappa_r' [1/m^2], 0 if not given.
    """
    scale = jnp.maximum(1 - curvature * offset, min_scale)
    twist = curvature * slope if curvature_slope is None else curvature * slope + curvature_slope * offset
    length = safe.sqrt(scale * scale + slope * slope)  # of the offset curve per metre of reference
    cos, tan = scale / length, slope / scale
    bent = ((bend + twist * tan) * cos * cos / scale + curvature) * cos / scale
    return heading + safe.arctan(tan), bent


def offset_length(
    curvature: Float[Array, "*q"], offset: Float[Array, "*q"], slope: Float[Array, "*q"]
) -> Float[Array, "*q"]:
    """Metres of the offset curve per metre of reference line, sqrt((1 - kappa d)^2 + d'^2)."""
    scale = 1 - curvature * offset
    return safe.sqrt(scale * scale + slope * slope)
