"""Lateral profiles d(s) from headings and curvatures: the inverse of `geometry.frenet.offset_curve`.

The reference's change of curvature along the station is left out in both directions, so that they are inverse to
each other, and curves that meet with equal (d, d', d'') meet with equal curvature.
"""

import jax.numpy as jnp
from jax import Array

from urbanjax.geometry.frenet import offset_curve, scale


def to_plane(heading: Array, kappa: Array, offset: Array, slope: Array, bend: Array) -> tuple[Array, Array]:
    """Heading (rad) and curvature (1/m) of lateral profiles, of the shape of `offset`.

    Args: heading (rad) and curvature kappa (1/m) of the reference, offset d (m), slope d', bend d'' (1/m), of shapes
    that broadcast.
    """
    heading, kappa = (jnp.broadcast_to(x, offset.shape) for x in (heading, kappa))
    return offset_curve(heading, kappa, offset=offset, slope=slope, bend=bend)


def from_plane(kappa: Array, offset: Array, tangent: Array, curvature: Array) -> tuple[Array, Array]:
    """Slope d' and bend d'' (1/m) of lateral profiles.

    Args: kappa of the reference (1/m), offset d (m), tangent of the heading from the reference's, curvature (1/m).
    """
    size = scale(kappa, offset)
    slope = tangent * size
    cosine = 1 / jnp.sqrt(1 + tangent * tangent)
    return slope, (curvature * size / cosine - kappa) * size / cosine**2 - kappa * slope * tangent
