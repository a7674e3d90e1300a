"""The shape of the surface around each point: normals and plane-regularised covariances."""

import functools
import itertools
import operator

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Float

from urbanjax.numerics import nearest, symmetric
from urbanjax.registration.points import PointCloud
from urbanjax.types import SHARE, field, pytree, static

UPRIGHT = 0.8  # least vertical component of the direction of an edge


@pytree
class FeatureParams:
    """Neighbourhoods and how flat a surface is taken to be."""

    thickness: float = 1e-3  # variance across the surface, as a share of that along it
    # share of the largest variance by which it exceeds the next, from which on it is an edge
    linearity: float = field(default=0.8, metadata=SHARE)
    neighbours: int = static(default=10)  # points that make a surface, the point itself included
    least: int = static(default=5)  # below which there is no surface
    visits: int = static(default=24)  # see numerics.nearest
    edges: bool = static(default=False)  # poles and corners are taken for lines instead of planes


def features(points: PointCloud, params: FeatureParams | None = None) -> tuple[PointCloud, Array]:
    """The cloud with normals towards its origin and covariances I - (1 - thickness) n n', and how far to rely on them.

    With `edges`, where neighbours lie along an upright line t, it is thickness I + (1 - thickness) t t' instead,
    without a normal. Points without enough neighbours get no normal and the identity, as in small_gicp. The points come
    out sorted along a space-filling curve, which makes later look-ups faster. Returns also the share of points whose
    neighbours are certainly the nearest ones. Args: points, the cloud in the frame of its sensor, or of the body.
    """
    params = FeatureParams() if params is None else params
    position, valid = lax.stop_gradient((points.position, points.valid))
    near = nearest.nearest(position, valid, k=params.neighbours, visits=params.visits)
    position, valid = points.position.T[near.order].T, points.valid[near.order]
    covariance, count = _spread(position, near)
    normal = symmetric.smallest_eigenvector(covariance)
    towards = jnp.where(symmetric.inner(normal, position) > 0, -1, 1)
    surface = valid & (count >= params.least)
    normal = jnp.where(surface[None], normal * towards[None], 0)
    ball = jnp.array(symmetric.IDENTITY, position.dtype)[:, None]
    flat = ball - (1 - params.thickness) * symmetric.outer(normal)
    if params.edges:
        flat, normal = _with_edges(covariance, surface, flat, normal, params)
    share = jnp.sum(near.exact & valid) / jnp.maximum(jnp.sum(valid), 1)
    return PointCloud(position, flat, normal, valid), share


def _with_edges(
    covariance: Float[Array, "6 n"], surface: Array, flat: Array, normal: Array, params: FeatureParams
) -> tuple[Float[Array, "6 n"], Float[Array, "3 n"]]:
    """The regularised covariances and normals with those of edges in place."""
    _, middle, high = symmetric.eigenvalues(covariance)
    direction = symmetric.smallest_eigenvector(-covariance)
    # Far from the sensor the neighbours of a point on the ground are those of its own ring: no edge.
    upright = jnp.abs(direction[2]) > UPRIGHT
    edge = surface & upright & (high - middle > params.linearity * high)
    along = symmetric.outer(direction)
    ball = jnp.array(symmetric.IDENTITY, covariance.dtype)[:, None]
    line = params.thickness * ball + (1 - params.thickness) * along
    return jnp.where(edge[None], line, flat), jnp.where(edge[None], 0, normal)


def _spread(position: Float[Array, "3 n"], near: nearest.Neighbours) -> tuple[Float[Array, "6 n"], Float[Array, " n"]]:
    """Covariance of the neighbours of each point, and their number."""
    count = jnp.sum(jnp.isfinite(near.squared), axis=0, dtype=position.dtype)
    share = 1 / jnp.maximum(count, 1)
    # Relative to the point: sums of squares of large coordinates would lose the thickness of a wall.
    beside = [x[near.index] - x[None] for x in position]
    mean = jnp.stack([_total(x) for x in beside]) * share[None]
    second = jnp.stack([_total(x * y) for x, y in itertools.combinations_with_replacement(beside, 2)])
    return second * share[None] - symmetric.outer(mean), count


def _total(rows: Float[Array, "k n"]) -> Float[Array, " n"]:
    """The sum of a few rows, which XLA then fuses with what they are made of."""
    return functools.reduce(operator.add, rows)
