"""Paths: what planning hands to behaviour and behaviour to control."""

from jax import Array

from urbanjax.types.struct import pytree


@pytree
class Path:
    """A path from the vehicle's present pose, on a station grid that all candidates of one step share.

    The grid is measured along the route's reference line, so that index k of two paths is the same station.
    """

    station: Array  # [K] m along the route's reference line (absolute, from the route's start)
    offset: Array  # [K] m, lateral offset from the reference line, left positive
    position: Array  # [K, 2] m
    heading: Array  # [K] rad
    curvature: Array  # [K] 1/m
