"""How sure a registration is: by what its pairs say, by where it started, and by the map's own error."""

import jax.numpy as jnp
from jax import Array, lax
from jax.scipy.linalg import solve_triangular
from jaxtyping import Float

from urbanjax.registration.linear import System, scatter
from urbanjax.registration.points import PointCloud
from urbanjax.types import POSITIVE, field, pytree

LEAST = 1e-6  # of information in units of the prior's, below which it counts as this much
RIDGE = 1e-9  # likewise of the scatter: without pairs nothing divides by 0
ALIKE = 0.1  # of the variance that equal residuals would have, below which that of few pairs that fit by chance is not


@pytree
class CovarianceParams:
    """What the covariance is calibrated with; scale and share are fitted to the errors of vgicp in synthetic worlds."""

    # s^2, variance over that of independent pairs: those of a voxel share its error
    scale: float = field(default=4.0, metadata=POSITIVE)
    share: float = 0.02  # of what its pairs say, up to which a direction has no evidence
    # rad, standard deviation of the start, and of the answer where there is no evidence
    prior_rotation: float = field(default=0.03, metadata=POSITIVE)
    prior_translation: float = field(default=0.3, metadata=POSITIVE)  # m, likewise
    floor_rotation: float = 2e-4  # rad, standard deviation of the map's own error, which is in every answer
    floor_translation: float = 2e-3  # m, likewise


def covariance(
    at: System, source: PointCloud, *, inliers: Float[Array, ""], params: CovarianceParams
) -> Float[Array, "6 6"]:
    """Covariance of the twist [rad, m]: (K' (s^2 M)^-1 K + P^-1)^-1 + F, with the start's P and the map's F.

    K is the Hessian H less `share` of G, of which each pair says as much in every direction as in all together, and M
    the sum of g g' by pairs. With K = H and neither P nor F it is s^2 times the sandwich H^-1 M H^-1, which no scale of
    the weights or of regularised covariances enters. But along a plane H promises what is not there: a point that moves
    along changes its voxel and takes its pull back. Directions with a generalised eigenvalue of H below `share` have no
    evidence, nor have so few pairs that some pose fits them all: there the start decides.
    Args: at, the problem at the pose found; source, the scan in its body frame; inliers, the number of its pairs.
    """
    rotation = jnp.stack([params.prior_rotation, params.floor_rotation]).astype(at.hessian.dtype)
    translation = jnp.stack([params.prior_translation, params.floor_translation]).astype(at.hessian.dtype)
    prior, floor = jnp.repeat(jnp.stack([rotation, translation], axis=1), 3, axis=1)
    # In units of the prior, in which radians and metres compare.
    unit, eye = prior[:, None] * prior[None, :], jnp.eye(6, dtype=prior.dtype)
    even = at.isotropic * unit
    root = jnp.linalg.cholesky(even + (jnp.finfo(even.dtype).eps * jnp.trace(even) + LEAST) * eye)
    value, axes = jnp.linalg.eigh(_between(root, at.hessian * unit))
    across = _product(axes.T, _product(_between(root, scatter(at, source) * unit), axes))
    free = 3 * inliers - 6
    equal = 2 * at.cost / jnp.maximum(free, 1) * jnp.maximum(value, 0)
    variance = params.scale * (across + jnp.diag(ALIKE * equal + RIDGE))
    known = jnp.where(free > 0, jnp.maximum(value - params.share, 0), 0)
    evidence = _product(root, axes) * known[None, :]
    information = _product(evidence, jnp.linalg.solve(variance, evidence.T))
    held = jnp.linalg.inv(eye + (information + information.T) / 2)
    return (held + held.T) / 2 * unit + jnp.diag(floor**2)


def _between(root: Array, matrix: Array) -> Array:
    """L^-1 A L^-T."""
    half = solve_triangular(root, matrix, lower=True)
    return solve_triangular(root, half.T, lower=True)


def _product(a: Array, b: Array) -> Array:
    return jnp.matmul(a, b, precision=lax.Precision.HIGHEST)
