"""The linearised registration problem: Hessian, gradient and cost at a pose, correspondences given (Eq. 3-5)."""

import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jaxtyping import Float, Int

from urbanjax.numerics import lean, safe, symmetric
from urbanjax.numerics.once import once
from urbanjax.registration import kernels
from urbanjax.registration.distributions import DistributionMap
from urbanjax.registration.kernels import KERNELS
from urbanjax.registration.points import PointCloud
from urbanjax.types import POSITIVE, SHARE, field, pytree, static

SMALL = 1e-3  # rad^2, below which the exponential is a series
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

    def back(self, vectors: Float[Array, "3 *n"]) -> Float[Array, "3 *n"]:
        """R' v."""
        x, y, z = vectors
        r = self.rotation
        return jnp.stack([r[0, i] * x + r[1, i] * y + r[2, i] * z for i in range(3)])

    def step(self, twist: Float[Array, "6"]) -> "Rigid":
        """T exp(twist), twist [omega; v]."""
        moved = displacement(twist)
        rotation = jnp.matmul(self.rotation, moved[:, 1:], precision=lax.Precision.HIGHEST)
        translation = jnp.matmul(self.rotation, moved[:, 0], precision=lax.Precision.HIGHEST)
        return Rigid(self.rotation + rotation, self.translation + translation)


@pytree
class System:
    """The problem at one pose, for twists [omega; v] of the body."""

    hessian: Array  # [6, 6]
    gradient: Array  # [6]
    cost: Array  # []
    isotropic: Array  # [6, 6] H if each pair said as much in every direction as in all together: sum w tr(Omega) J' J
    sums: Array  # [10, 10] over the points, of (1, s, s s') times w (Omega, Omega e, e' Omega e)
    pulled: Array  # [3, N] w Omega e, in the body frame
    near: Array  # [N] bool, there is a correspondence
    apart: Array  # [N] m^2, squared distance from its mean


def linearise(
    pose: Rigid, source: PointCloud, *, slot: Int[Array, " n"], target: DistributionMap, params: FactorParams
) -> System:
    """Hessian, gradient and cost at a pose relative to the map's origin, with Omega frozen (Eq. 3-4).

    In the body frame, where J = [[s]x, -I] does not depend on the pose: every sum over the points is one entry of the
    product of (1, s, s s') with (Omega, Omega e, e' Omega e), and H and b are linear in those. Args: pose, of the body
    from the map's origin; source, the scan in its body frame; slot [N], a row of the map for each point; target, the
    map.
    """
    rows = target.rows.at[slot].get(mode="promise_in_bounds")
    held = jnp.matmul(_into_body(pose.rotation), rows.T, precision=lax.Precision.HIGHEST)
    residual = held[:3] - (source.position + pose.back(pose.translation)[:, None])
    sigma = held[3:9] if target.method == "ndt" else held[3:9] + source.covariance
    # What many things are made of is computed once: else the compiler computes it anew for each of them.
    apart = symmetric.inner(residual, residual)
    inverse = safe.divide(jnp.ones_like(apart), symmetric.determinant(sigma))
    *residual, scale, apart, count = once(*residual, inverse, apart, held[9])
    near = (count > 0) & (apart <= params.max_distance**2)
    share = {"one": jnp.ones_like, "sqrt_count": safe.sqrt, "count": lambda c: c}[params.weight](count)
    information = jnp.stack(once(*(symmetric.adjugate(sigma) * scale[None])))
    residual = jnp.stack(residual)
    pulled = symmetric.product(information, residual)
    squared = symmetric.inner(residual, pulled)
    if target.method == "ndt":
        weight = kernels.likelihood(squared, params.outlier_share, resolution=target.resolution)
    else:
        weight = kernels.weight(squared, params.kernel, scale=params.kernel_scale)
    values = jnp.concatenate([information, pulled, squared[None]]) * jnp.where(near, share * weight, 0)[None]
    position = source.position
    moments = jnp.concatenate([jnp.ones_like(position[:1]), position, symmetric.outer(position)])
    sums = _product(moments, values)
    system = jnp.matmul(jnp.asarray(ASSEMBLY, sums.dtype), sums.reshape(100), precision=lax.Precision.HIGHEST)
    return System(
        hessian=system[:36].reshape(6, 6),
        gradient=system[36:42],
        cost=system[42],
        isotropic=system[43:].reshape(6, 6),
        sums=sums,
        pulled=values[6:9],
        near=near,
        apart=apart,
    )


def change(at: System, moved: Float[Array, "3 4"]) -> Float[Array, ""]:
    """By how much a move of the body changes the cost, with correspondences and weights held.

    It takes e' Omega e to (e - p)' Omega (e - p), p = moved (1, s): the sums of the system say it all.
    Args: at, the problem before it; moved, as from `displacement`.
    """
    flat = moved.T.reshape(12)
    square = lean.rows(at.sums.reshape(100), jnp.asarray(SQUARE))
    pull = at.sums[:4, 6:9].reshape(12)
    turned = jnp.matmul(square, flat, precision=lax.Precision.HIGHEST)
    return jnp.dot(flat, turned / 2 - pull, precision=lax.Precision.HIGHEST)


def scatter(at: System, source: PointCloud) -> Float[Array, "6 6"]:
    """Sum g g' of what each pair adds to the gradient, g = J' Omega e: how far the sum of them can be off 0.

    Args: at, the problem at a pose; source, the scan in its body frame.
    """
    pulled = at.pulled
    x, y, z = source.position
    torque = jnp.stack([y * pulled[2] - z * pulled[1], z * pulled[0] - x * pulled[2], x * pulled[1] - y * pulled[0]])
    force = jnp.concatenate([torque, pulled])
    return _product(force, force)


def displacement(twist: Float[Array, "6"]) -> Float[Array, "3 4"]:
    """By how much exp(twist) moves a point s of the body, as a matrix to multiply (1, s) with.

    Args: twist [omega; v], rad and m.
    """
    x, y, z = turn = twist[:3]
    squared = x * x + y * y + z * z
    small = squared < SMALL
    angle = safe.sqrt(jnp.where(small, SMALL, squared))
    first = jnp.where(small, 1 - squared / 6 * (1 - squared / 20), jnp.sin(angle) / angle)
    second = jnp.where(small, (1 - squared / 12 * (1 - squared / 30)) / 2, (1 - jnp.cos(angle)) / angle**2)
    third = jnp.where(small, (1 - squared / 20 * (1 - squared / 42)) / 6, (1 - jnp.sin(angle) / angle) / angle**2)
    zero = jnp.zeros_like(x)
    across = jnp.stack([zero, -z, y, z, zero, -x, -y, x, zero]).reshape(3, 3)
    twice = turn[:, None] * turn[None, :] - squared * jnp.eye(3, dtype=twist.dtype)
    along = twist[3:] + jnp.sum((second * across + third * twice) * twist[None, 3:], axis=1)
    return jnp.concatenate([along[:, None], first * across + second * twice], axis=1)


def _product(a: Array, b: Array) -> Array:
    return lax.dot_general(a, b, (((1,), (1,)), ((), ())), precision=lax.Precision.HIGHEST)


def _into_body(rotation: Float[Array, "3 3"]) -> Float[Array, "10 10"]:
    """What takes rows of the map into the body frame, less where that is: R' mean, R' Sigma R, and the number."""
    back = rotation.T
    first, second = (lean.rows(back, jnp.asarray(which)) for which in (ROW, COLUMN))
    pairs = (first[:, :, None] * second[:, None, :]).reshape(6, 9)
    turned = jnp.matmul(pairs, jnp.asarray(FOLD, rotation.dtype), precision=lax.Precision.HIGHEST)
    return jnp.zeros((10, 10), rotation.dtype).at[:3, :3].set(back).at[3:9, 3:9].set(turned).at[9, 9].set(1)


# Of (1, s, s s') the one that is the product of two of (1, s), of Omega the entry (i, j), and both among the sums.
MOMENT = np.array([[0, 1, 2, 3], [1, 4, 5, 6], [2, 5, 7, 8], [3, 6, 8, 9]])
ENTRY = np.array(symmetric.PLACE)
SQUARE = (10 * MOMENT[:, None, :, None] + ENTRY[None, :, None, :]).reshape(12, 12).astype(np.int32)
ROW, COLUMN = np.array(symmetric.ENTRIES, np.int32).T
FOLD = (ENTRY.reshape(9, 1) == np.arange(6)).astype(float)  # what each entry (i, j) counts for among the six

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
