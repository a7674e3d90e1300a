"""The shape of the surface around each point: normals and plane-regularised covariances."""

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Float

from urbanjax.numerics import nearest, symmetric
from urbanjax.registration.points import PointCloud
from urbanjax.types import pytree, static


@pytree
class FeatureParams:
    """Neighbourhoods and how flat a surface is taken to be."""

    thickness: float = 1e-3  # variance across the surface, as a share of that along it
    neighbours: int = static(default=10)  # points that make a surface, the point itself included
    least: int = static(default=5)  # below which there is no surface
    block: int = static(default=16)  # see numerics.nearest
    visits: int = static(default=16)


def features(points: PointCloud, params: FeatureParams | None = None) -> tuple[PointCloud, Array]:
    """The cloud with normals towards its origin and covariances I - (1 - thickness) n n', and how far to rely on them.

    Points without enough neighbours get no normal and the identity, as in small_gicp. The points come out sorted along
    a space-filling curve, which makes later look-ups faster. Returns also the share of points whose neighbours are
    certainly the nearest ones.
    """
    params = FeatureParams() if params is None else params
    blocks = nearest.arrange(points.position, points.valid, params.block, params.visits)
    squared = nearest.distances(blocks)
    n = points.valid.shape[0]
    enough = jnp.sum(points.valid) >= params.neighbours
    bound = nearest.reach(squared, params.neighbours)
    inside = (squared <= jnp.minimum(bound, jnp.finfo(squared.dtype).max)[..., None]).astype(squared.dtype)
    covariance, count = _spread(blocks, inside)
    normal = symmetric.smallest_eigenvector(covariance)
    position = blocks.position.reshape(3, -1)
    towards = jnp.where(symmetric.inner(normal, position) > 0, -1, 1)
    surface = blocks.valid.reshape(-1) & (count >= params.least)
    normal = jnp.where(surface[None], normal * towards[None], 0)
    ball = jnp.array(symmetric.IDENTITY, position.dtype)[:, None]
    flat = ball - (1 - params.thickness) * symmetric.outer(normal)
    valid = blocks.valid.reshape(-1)[:n]
    exact = (bound <= blocks.beyond[:, None]).reshape(-1)[:n] & enough
    share = jnp.sum(exact & valid) / jnp.maximum(jnp.sum(valid), 1)
    return PointCloud(position[:, :n], flat[:, :n], normal[:, :n], valid), share


def _spread(blocks: nearest.Blocks, inside: Float[Array, "g b c"]) -> tuple[Float[Array, "6 n"], Float[Array, " n"]]:
    """Covariance of the candidates inside each point's neighbourhood, and their number."""
    # Relative to the block: sums of squares of large coordinates would lose the thickness of a wall.
    beside = nearest.candidates(blocks) - blocks.position[:, :, :1]
    moments = jnp.concatenate([jnp.ones_like(beside[:1]), beside, symmetric.outer(beside)])
    sums = lax.dot_general(inside, moments, (((2,), (2,)), ((0,), (1,))), precision=lax.Precision.HIGHEST)  # [G, B, 10]
    sums = jnp.moveaxis(sums, -1, 0).reshape(10, -1)
    number = sums[0]
    mean = sums[1:4] / jnp.maximum(number, 1)[None]
    return sums[4:] / jnp.maximum(number, 1)[None] - symmetric.outer(mean), number
