"""The linearised registration problem: Hessian, gradient and cost at a pose, correspondences given (Eq. 3-5)."""

import jax.numpy as jnp
import jaxlie
import numpy as np
from jax import Array, lax
from jaxtyping import Float, Int

from urbanjax.numerics import safe, symmetric
from urbanjax.registration import kernels
from urbanjax.registration.distributions import DistributionMap
from urbanjax.registration.kernels import KERNELS
from urbanjax.registration.points import PointCloud
from urbanjax.types import POSITIVE, SHARE, field, pytree, static

WEIGHTS = ("one", "sqrt_count", "count")


@pytree
class FactorParams:
    """What counts as a correspondence, and what it weighs."""

    max_distance: float = field(default=1.0, metadata=POSITIVE)  # m, of a point from its distribution's mean
    # [-], Mahalanobis distance at which a robust kernel sets in
    kernel_scale: float = field(default=3.0, metadata=POSITIVE)
    outlier_share: float = field(default=0.55, metadata=SHARE)  # of points that the map does not explain (ndt only)
    weight: str = static(default="one", metadata={"choices": WEIGHTS})  # by the number of points of the voxel
    kernel: str = static(default="none", metadata={"choices": KERNELS})


@pytree
class Rigid:
    """A pose as matrix and translation, which costs fewer operations in a loop than a quaternion."""

    rotation: Array  # [3, 3]
    translation: Array  # [3] m

    def move(self, points: Float[Array, "3 n"]) -> Float[Array, "3 n"]:
        """R s + t."""
        x, y, z = points
        r, t = self.rotation, self.translation
        return jnp.stack([r[i, 0] * x + r[i, 1] * y + r[i, 2] * z + t[i] for i in range(3)])

    def back(self, vectors: Float[Array, "3 n"]) -> Float[Array, "3 n"]:
        """R' v."""
        x, y, z = vectors
        r = self.rotation
        return jnp.stack([r[0, i] * x + r[1, i] * y + r[2, i] * z for i in range(3)])

    def step(self, twist: Float[Array, "6"]) -> "Rigid":
        """T exp(twist), twist [omega; v]."""
        moved = jaxlie.SE3.exp(jnp.concatenate([twist[3:], twist[:3]]))
        rotation = jnp.matmul(self.rotation, moved.rotation().as_matrix(), precision=lax.Precision.HIGHEST)
        translation = jnp.matmul(self.rotation, moved.translation(), precision=lax.Precision.HIGHEST)
        return Rigid(rotation, self.translation + translation)


@pytree
class Correspondences:
    """Correspondences: what the map holds for each point."""

    mean: Array  # [3, N] m from the map's origin
    covariance: Array  # [6, N]
    weight: Array  # [N] 0 without a correspondence
    near: Array  # [N] bool, there is one


@pytree
class System:
    """The problem at one pose, for twists [omega; v] of the body."""

    hessian: Array  # [6, 6]
    gradient: Array  # [6]
    cost: Array  # []
    isotropic: Array  # [6, 6] H if each pair said as much in every direction as in all together: sum w tr(Omega) J' J
    residual: Array  # [3, N] m in the body frame
    information: Array  # [6, N] in the body frame
    weight: Array  # [N]


def pairs_of(
    target: DistributionMap, slot: Int[Array, " n"], *, away: Float[Array, "3 n"], params: FactorParams
) -> Correspondences:
    """What the map holds in its rows `slot`, for points `away`; nothing if too far.

    Args: target, the map; slot [N], one row of it for each point; away [3, N] m, the points from its origin.
    """
    rows = target.rows[slot].T
    count = rows[9]
    near = (count > 0) & (jnp.sum((rows[:3] - away) ** 2, axis=0) <= params.max_distance**2)
    weight = {"one": jnp.ones_like, "sqrt_count": safe.sqrt, "count": lambda c: c}[params.weight](count)
    ball = jnp.array(symmetric.IDENTITY, count.dtype)[:, None]
    return Correspondences(
        mean=rows[:3], covariance=jnp.where(near[None], rows[3:9], ball), weight=jnp.where(near, weight, 0), near=near
    )


def linearise(
    pose: Rigid, source: PointCloud, *, pairs: Correspondences, target: DistributionMap, params: FactorParams
) -> System:
    """Hessian, gradient and cost at a pose relative to the map's origin, with Omega frozen (Eq. 3-4).

    In the body frame, where J = [[s]x, -I] does not depend on the pose: every sum over the points is one entry of the
    product of (1, s, s s') with (Omega, Omega e, e' Omega e), and H and b are linear in those. Args: pose, of the body
    from the map's origin; source, the scan in its body frame; pairs, what the map holds for its points; target, the
    map, for its method and resolution.
    """
    residual = pose.back(pairs.mean - pose.move(source.position))
    sigma = symmetric.congruence(pose.rotation.T, pairs.covariance)
    if target.method != "ndt":
        sigma = sigma + source.covariance
    information = symmetric.inverse(sigma)
    pulled = symmetric.product(information, residual)
    squared = symmetric.inner(residual, pulled)
    if target.method == "ndt":
        weight = pairs.weight * kernels.likelihood(squared, params.outlier_share, resolution=target.resolution)
    else:
        weight = pairs.weight * kernels.weight(squared, params.kernel, scale=params.kernel_scale)
    values = jnp.concatenate([information, pulled, squared[None]]) * weight[None]
    position = source.position
    moments = jnp.concatenate([jnp.ones_like(position[:1]), position, symmetric.outer(position)])
    sums = _product(moments, values)
    system = jnp.matmul(jnp.asarray(ASSEMBLY, sums.dtype), sums.reshape(100), precision=lax.Precision.HIGHEST)
    return System(
        hessian=system[:36].reshape(6, 6),
        gradient=system[36:42],
        cost=system[42],
        isotropic=system[43:].reshape(6, 6),
        residual=residual,
        information=information,
        weight=weight,
    )


def held_cost(
    pose: Rigid, at: System, *, before: Rigid, source: PointCloud, pairs: Correspondences
) -> Float[Array, ""]:
    """The cost at another pose with correspondences and weights held.

    Args: pose, from the map's origin; at, the problem at the pose `before`; source, the scan; pairs, what the map holds
    for its points.
    """
    residual = before.back(pairs.mean - pose.move(source.position))
    squared = symmetric.inner(residual, symmetric.product(at.information, residual))
    return jnp.dot(at.weight, squared, precision=lax.Precision.HIGHEST) / 2


def scatter(at: System, source: PointCloud) -> Float[Array, "6 6"]:
    """Sum g g' of what each pair adds to the gradient, g = J' Omega e: how far the sum of them can be off 0.

    Args: at, the problem at a pose; source, the scan in its body frame.
    """
    pulled = symmetric.product(at.information, at.residual) * at.weight[None]
    x, y, z = source.position
    torque = jnp.stack([y * pulled[2] - z * pulled[1], z * pulled[0] - x * pulled[2], x * pulled[1] - y * pulled[0]])
    each = jnp.concatenate([torque, pulled])
    return _product(each, each)


def _product(a: Array, b: Array) -> Array:
    return lax.dot_general(a, b, (((1,), (1,)), ((), ())), precision=lax.Precision.HIGHEST)


# [e]x for the three unit vectors: [s]x = sum_c s_c SKEW[c].
SKEW = np.cross(np.eye(3)[:, None, :], np.eye(3)[None, :, :]).transpose(0, 2, 1)


def _assembly() -> np.ndarray:
    """[79, 100]: H (36), b (6), the cost and the isotropic H (36) from the ten moments times the ten values."""
    place = np.array(symmetric.PLACE)
    out = np.zeros((79, 10, 10))
    hessian = out[:36].reshape(6, 6, 10, 10)
    for k in range(3):
        for m in range(3):
            entry = place[k, m]
            hessian[3 + k, 3 + m, 0, entry] += 1
            for c in range(3):
                # H_rt = -[s]x' Omega = [s]x Omega
                hessian[:3, 3 + m, 1 + c, entry] += SKEW[c][:, k]
                hessian[3 + m, :3, 1 + c, entry] += SKEW[c][:, k]
                for d in range(3):
                    hessian[:3, :3, 4 + place[c, d], entry] += np.outer(SKEW[c][k], SKEW[d][m])
    for k in range(3):
        out[36 + 3 + k, 0, 6 + k] -= 1
        for c in range(3):
            out[36:39, 1 + c, 6 + k] -= SKEW[c][:, k]
    out[42, 0, 9] = 0.5
    # H with tr(Omega) I in place of Omega.
    diagonal = place.diagonal()
    out[43:, :, diagonal] = out[:36, :, diagonal].sum(-1, keepdims=True)
    return out.reshape(79, 100)


ASSEMBLY = _assembly()
