"""The curves that join the nodes of consecutive layers: how long they are, how sharp, and whether they leave the road.

Along an edge the lateral offset d is a function of the share u of the step, 0 to 1, linear in the offsets and the
slopes at both ends. Two profiles are known. `QUINTIC` has heading and curvature of the nodes at both ends, so that a
path through the lattice is smooth in the plane. `CORNER` is straight in the Frenet frame and is meant to be read off
as the uniform cubic B-spline over the nodes, which spreads each corner over the steps beside it: a step sideways
between two along the lane then has d'' = step / spacing^2 at its ends.
"""

import functools
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float
from numpy.polynomial import Polynomial

from urbanjax.geometry.frenet import scale
from urbanjax.numerics import lean, soft
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning.cross_section import CrossSections, drivable
from urbanjax.types import SOFT, pytree
from urbanjax.vehicle.params import VehicleParams


class EdgeProfile(NamedTuple):
    """A lateral profile at P shares of a step."""

    shares: np.ndarray  # [P], the first is 0, the last 1
    weights: np.ndarray  # [P] of the integral over the step
    basis: np.ndarray  # [3, P, 4] value, first and second derivative by u, of both offsets and both slopes


@pytree
class Steps:
    """The road along the steps between consecutive layers, at P shares of each."""

    spacing: Array  # [e] m, along the reference line
    curvature: Array  # [e, P] 1/m, of the reference line
    right: Array  # [e, P] m, offset of the right border of the width that is open
    left: Array  # [e, P] m


@pytree
class Edges:
    """All edges of e steps, from row to column."""

    detour: Array  # [e, M, M] m, by which an edge is longer than its step along the reference line (inside: shorter)
    curvature: Array  # [e, M, M] 1/m, the greatest size along it
    bending: Array  # [e, M, M] 1/m, integral of the squared curvature
    outside: Array  # [e, M, M] m, by which the footprint leaves the open width at most; negative within


def _quintic() -> EdgeProfile:
    """Offset and slope given at both ends, second derivative 0; its greatest curvature on a straight is a sample."""
    peak = 0.5 - 0.5 / np.sqrt(3)
    shares = np.array([0.0, 0.07, peak, 0.39, 0.5, 0.61, 1 - peak, 0.93, 1.0])
    weights = np.linalg.solve(np.vander(shares, increasing=True).T, 1 / np.arange(1, 10))
    return EdgeProfile(shares, weights, quintic_basis(shares))


def quintic_basis(shares: np.ndarray) -> np.ndarray:
    """Value, first and second derivative [3, P, 4] by u of the quintics of both offsets and both slopes.

    Args: shares [P] (host), the u at which they are taken.
    """
    powers = [(1, 0, 0, -10, 15, -6), (0, 0, 0, 10, -15, 6), (0, 1, 0, -6, 8, -3), (0, 0, 0, -4, 7, -3)]
    basis = [[Polynomial(p).deriv(k)(shares) for p in powers] for k in range(3)]
    return np.array(basis).transpose(0, 2, 1)


def _corner() -> EdgeProfile:
    shares, none = np.array([0.0, 0.5, 1.0]), np.zeros(3)
    basis = [
        [1 - shares, shares, none, none],
        [none - 1, none + 1, none, none],
        [2 * shares - 1, 1 - 2 * shares, none, none],
    ]
    return EdgeProfile(shares, np.array([1.0, 4.0, 1.0]) / 6, np.array(basis).transpose(0, 2, 1))


QUINTIC, CORNER = _quintic(), _corner()


def fine_stations(station: Float[Array, "s"], profile: EdgeProfile) -> Float[Array, "n"]:
    """Stations [1 + (S - 1)(P - 1)] (m) of all shares of the steps between layers, each once.

    Args: station [S] m, of the layers; profile, of the edges.
    """
    shares = profile.shares[None, 1:].astype(station.dtype)
    inner = station[:-1, None] * (1 - shares) + station[1:, None] * shares
    return jnp.concatenate([station[:1], inner.ravel()])


def layers_of(road: CrossSections, profile: EdgeProfile) -> CrossSections:
    """The road at the layers alone. Args: road, at the `fine_stations`; profile, of the edges."""
    return jax.tree.map(lambda x: x[:: profile.shares.size - 1], road)


def steps_along(road: CrossSections, spacing: Float[Array, "e"], *, profile: EdgeProfile) -> Steps:
    """The road along the steps.

    Args: road, at the `fine_stations`; spacing [e] m, of the layers; profile, of the edges.
    """
    right, left = drivable(road)
    count, parts = spacing.shape[0], profile.shares.size - 1

    def each(values: Array) -> Array:
        return jnp.concatenate([values[:-1:parts, None], values[1:].reshape(count, parts)], axis=1)

    return Steps(spacing=spacing, curvature=each(road.curvature), right=each(right), left=each(left))


def join(
    offset: tuple[Float[Array, "e m"], Float[Array, "e k"]],
    slope: tuple[Float[Array, "e m"], Float[Array, "e k"]],
    *,
    steps: Steps,
    profile: EdgeProfile,
    vehicle: VehicleParams,
) -> Edges:
    """All edges from the nodes at the start of each step to those at its end.

    Length and bending are integrals along the offset curve, of sqrt((1 - kappa d)^2 + d'^2) and of its curvature
    squared, exact where that is a polynomial in u of degree 9, or 3 with CORNER; QUINTIC's are within 1e-5 and 0.5 % on
    edges that move sideways by up to 0.4 of the step. The greatest curvature is that of the P samples.
    Args: offset (m) and slope d' of the nodes [e, M] at the start and [e, K] at the end; steps, the road along them;
    profile, of the edges; vehicle.
    """
    spacing, half = steps.spacing[:, None, None], vehicle.width / 2
    change = ((steps.curvature[:, -1:] - steps.curvature[:, :1]) / steps.spacing[:, None])[:, :, None]
    powers = jnp.stack([jnp.ones_like(spacing), spacing, spacing * spacing])[:, None]

    def parts(end: int, nodes: tuple[int, ...]) -> list[tuple[Array, ...]]:
        """What the nodes of one end contribute to value, slope and bend, [3][P] arrays of the shape `nodes`."""
        weight, turn = (profile.basis[:, :, i, None, None, None].astype(spacing.dtype) for i in (end, end + 2))
        place, lean = (x.reshape(1, 1, *nodes) for x in (offset[end], slope[end] * steps.spacing[:, None]))
        return [jnp.unstack(x) for x in jnp.unstack((weight * place + turn * lean) / powers)]

    starts, ends = parts(0, (*offset[0].shape, 1)), parts(1, (len(offset[1]), 1, offset[1].shape[1]))
    road = [jnp.unstack(x[:, :, None, None], axis=1) for x in (steps.curvature, steps.left, steps.right)]

    def at(p: int) -> Edges:
        """All edges at one share, lengths as rates."""
        value, rise, bend = (starts[k][p] + ends[k][p] for k in range(3))
        kappa, left, right = (x[p] for x in road)
        size = scale(kappa, value)
        squared = size * size + rise * rise
        rate = jnp.sqrt(squared)
        # That of `geometry.frenet.offset_curve`, with one division for its five: there are many edges.
        twist = (kappa * rise + change * value) * rise
        sharp = (bend * size + twist + kappa * squared) / (squared * rate)
        outside = lean.maximum(value - left, right - value) + half
        return Edges(detour=rate - 1, curvature=jnp.abs(sharp), bending=rate * sharp * sharp, outside=outside)

    # Share by share: as one array with a further axis, or as a loop, it would take twice as long.
    found = [at(p) for p in range(profile.shares.size)]

    def integral(name: str) -> Array:
        first, *others = (w * getattr(x, name) for w, x in zip(profile.weights, found, strict=True))
        return sum(others, start=first) * spacing

    def greatest(name: str) -> Array:
        return functools.reduce(jnp.maximum, (getattr(x, name) for x in found))

    return Edges(integral("detour"), greatest("curvature"), integral("bending"), greatest("outside"))


@pytree
class EdgeLimits:
    """What an edge may not exceed."""

    PINNED: ClassVar[dict[str, str]] = {
        "max_curvature": "safety: what an edge may not exceed",
        "steering_share": "safety: what the steering can follow",
        "tolerance": "safety: of leaving the road",
        "*_scale": SOFT,
    }

    max_curvature: float = 1.0  # 1/m, or what the steering allows where that is less
    steering_share: float = 1.0  # of the curvature that the steering allows
    tolerance: float = 0.15  # m, by which the footprint may leave the road
    curvature_scale: float = 0.01  # 1/m, clearly too sharp
    edge_scale: float = 0.05  # m, clearly off the road


def sharpest(vehicle: VehicleParams, limits: EdgeLimits) -> Array:
    """The greatest curvature [] (1/m) that an edge may have. Args: vehicle; limits, of the edges."""
    steering = jnp.tan(jnp.asarray(vehicle.max_steering)) / vehicle.wheelbase
    return lean.minimum(limits.max_curvature, limits.steering_share * steering)


def refused(
    edges: Edges, sharpest: Array | float, *, limits: EdgeLimits, relaxation: Relaxation
) -> Float[Array, "e m k"]:
    """Degree [e, M, K] to which each edge is too sharp or leaves the road.

    Args: edges; sharpest 1/m, a number or [e, 1, 1]; limits; relaxation, of the degree.
    """
    sharp = soft.above(edges.curvature - sharpest, 0.0, relaxation, scale=limits.curvature_scale)
    return soft.either(sharp, soft.above(edges.outside, limits.tolerance, relaxation, scale=limits.edge_scale))
