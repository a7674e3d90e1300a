"""Alignment of a scan with a map of distributions: one damped Gauss-Newton loop for all methods (Eq. 1-5).

Twists are ordered [omega; v] and belong to the body: T <- T exp(twist), so that the Hessian and the covariance read
off as roll, pitch, yaw, longitudinal, lateral and vertical.
"""

import jax
import jax.numpy as jnp
import jaxlie
from jax import Array, lax

from urbanjax.registration.correspond import correspond
from urbanjax.registration.covariance import CovarianceParams, covariance
from urbanjax.registration.distributions import DistributionMap
from urbanjax.registration.linear import (
    FactorParams,
    Rigid,
    System,
    change,
    displacement,
    linearise,
)
from urbanjax.registration.points import PointCloud, thinned
from urbanjax.types import Status, pytree, static

# Units in the last place by which a step may raise the cost: near the minimum it is flat, and what rounding adds is no
# reason to refuse a step.
ROUNDING = 16
FEW = 1000  # points from which on a share of them is looked at first


@pytree
class AlignParams:
    """Correspondences, when to stop, and how sure the answer is."""

    factor: FactorParams = FactorParams()
    covariance: CovarianceParams = CovarianceParams()
    rotation_tolerance: float = 1.75e-3  # rad, step below which it has converged
    translation_tolerance: float = 1e-3  # m, likewise
    damping: float = 1e-3  # at the start, added to the diagonal of the Hessian
    damping_factor: float = 10.0  # by which it changes
    neighbours: int = static(default=1, metadata={"choices": (1, 7, 27)})  # voxels that a point may belong to
    max_iterations: int = static(default=20)
    coarse: int = static(default=8)  # of so many points one is looked at, until all of them are (not with ndt)


@pytree
class Alignment:
    """The pose, and what spoke for it in the last iteration, one step before it."""

    pose: jaxlie.SE3  # T_map_body, the only field with a derivative
    converged: Array  # [] bool; never without a correspondence
    iterations: Array  # [] int32, with all points
    inliers: Array  # [] number of points with a correspondence
    inlier_share: Array  # [] of the valid points
    matching_error: Array  # [] m, mean distance from the corresponding means (Eq. 1); 0 without inliers
    cost: Array  # [] half the weighted sum of squared Mahalanobis distances (Eq. 4)
    gradient: Array  # [6] b, of the cost with frozen weights
    hessian: Array  # [6, 6] H
    covariance: Array  # [6, 6] of the twist [rad, m], calibrated as CovarianceParams says

    @property
    def status(self) -> Array:
        """[] int32, a Status."""
        failed = jnp.where(self.inlier_share > 0, int(Status.NOT_CONVERGED), int(Status.NO_PAIRS))
        return jnp.where(self.converged, int(Status.OK), failed)


def align(
    source: PointCloud, target: DistributionMap, *, start: jaxlie.SE3, params: AlignParams | None = None
) -> Alignment:
    """The pose of `source` in the frame of `target`, from a `start` nearby; jit it, and vmap it over starts or pairs.

    Gradients of the pose with respect to the points, the map and the parameters are those of the fixed point (implicit
    function theorem), with correspondences held; there is none with respect to the start. Failure is a value: look at
    `status` and `inlier_share`. Args: source, the scan in its body frame; target, the map; start, T_map_body nearby.
    """
    params = AlignParams() if params is None else params
    begin = Rigid(start.rotation().as_matrix(), start.translation() - target.origin)
    search = _search(*lax.stop_gradient((source, target, begin, params)))
    pose = _implicit(search.pose, source, target, params)
    at, dtype = search.system, source.position.dtype
    inliers = jnp.sum(at.near, dtype=dtype)
    total = jnp.maximum(jnp.sum(source.valid, dtype=dtype), 1)
    rotation = jaxlie.SO3.from_matrix(pose.rotation)
    return Alignment(
        pose=jaxlie.SE3.from_rotation_and_translation(rotation, pose.translation + target.origin),
        converged=search.converged & (inliers > 0),
        iterations=search.iterations,
        inliers=inliers,
        inlier_share=inliers / total,
        matching_error=jnp.sum(jnp.sqrt(jnp.where(at.near, at.apart, 0))) / jnp.maximum(inliers, 1),
        cost=at.cost,
        gradient=at.gradient,
        hessian=at.hessian,
        covariance=covariance(
            at, lax.stop_gradient(source), inliers=inliers, params=lax.stop_gradient(params.covariance)
        ),
    )


def align_starts(
    source: PointCloud,
    target: DistributionMap,
    *,
    starts: jaxlie.SE3,
    params: AlignParams | None = None,
    at_once: int = 1,
) -> Alignment:
    """The alignments from many starts of one pair, stacked along the first axis.

    Args: source, the scan in its body frame; target, the map; starts, stacked poses T_map_body; at_once, how many run
    together: 1 on a CPU, where each then stops when it has converged instead of waiting for the slowest, many on a GPU.
    """
    return lax.map(lambda start: align(source, target, start=start, params=params), starts, batch_size=at_once)


@pytree
class _Search:
    """What the loop carries."""

    pose: Rigid  # from the map's origin
    damping: Array
    iterations: Array
    converged: Array
    system: System  # of the last iteration


def _search(source: PointCloud, target: DistributionMap, start: Rigid, params: AlignParams) -> _Search:
    """The loop, with a share of the points until those have nothing more to say, and then with all of them.

    With `ndt` with all of them at once: it creeps to its answer, and stops elsewhere where a share has led it.
    """
    now = _begin(start, source, params)
    enough = source.valid.shape[0] >= FEW * params.coarse > FEW
    if enough and params.max_iterations > 1 and target.method != "ndt":
        few = thinned(source, params.coarse)
        limit = jnp.where(jnp.sum(few.valid) >= FEW, params.max_iterations // 2, 0)
        rough = _descend(few, target, _begin(start, few, params), params, limit=limit)
        now = now.replace(pose=rough.pose)
    return _descend(source, target, now, params, limit=params.max_iterations)


def _begin(pose: Rigid, source: PointCloud, params: AlignParams) -> _Search:
    """The state of the loop before it."""
    n, dtype = source.valid.shape[0], pose.translation.dtype
    eye = jnp.eye(6, dtype=dtype)

    def nothing(*shape: int) -> Array:
        return jnp.zeros(shape, dtype)

    return _Search(
        pose=pose,
        damping=jnp.asarray(params.damping, dtype),
        iterations=jnp.asarray(0, jnp.int32),
        converged=jnp.asarray(False),
        system=System(
            hessian=eye,
            gradient=nothing(6),
            cost=nothing(),
            isotropic=eye,
            sums=nothing(10, 10),
            pulled=nothing(3, n),
            near=jnp.zeros(n, bool),
            apart=nothing(n),
        ),
    )


def _descend(
    source: PointCloud, target: DistributionMap, begin: _Search, params: AlignParams, *, limit: int | Array
) -> _Search:
    """The loop: linearise, step, and damp more where the step did not lower the cost. Not differentiated."""
    dtype = begin.pose.translation.dtype
    eye = jnp.eye(6, dtype=dtype)

    def unfinished(now: _Search) -> Array:
        return (now.iterations < limit) & ~now.converged

    def iterate(now: _Search) -> _Search:
        slot = correspond(target, now.pose.move(source.position), valid=source.valid, neighbours=params.neighbours)
        at = linearise(now.pose, source, slot=slot, target=target, params=params.factor)
        twist = -jnp.linalg.solve(at.hessian + now.damping * eye, at.gradient)
        trial = now.pose.step(twist)
        better = change(at, displacement(twist)) <= at.cost * ROUNDING * jnp.finfo(dtype).eps
        rotation, translation = jnp.sum(twist[:3] ** 2), jnp.sum(twist[3:] ** 2)
        small = (rotation <= params.rotation_tolerance**2) & (translation <= params.translation_tolerance**2)
        return _Search(
            pose=jax.tree.map(lambda new, old: jnp.where(better, new, old), trial, now.pose),
            damping=now.damping * jnp.where(better, 1 / params.damping_factor, params.damping_factor),
            iterations=now.iterations + 1,
            converged=better & small,
            system=at,
        )

    return lax.while_loop(unfinished, iterate, begin)


@jax.custom_jvp
def _implicit(pose: Rigid, source: PointCloud, target: DistributionMap, params: AlignParams) -> Rigid:
    """The pose itself, with the derivative of the fixed point sum J' Omega e = 0 by all but the pose.

    -(dF/d twist)^-1 dF/d theta; dF/d twist, by six forward-mode columns, holds the derivatives of J and Omega too, and
    is not the Hessian of the frozen problem.
    """
    return pose


@_implicit.defjvp
def _implicit_jvp(primals: tuple, tangents: tuple) -> tuple[Rigid, Rigid]:
    pose, source, target, params = primals
    slot = correspond(target, pose.move(source.position), valid=source.valid, neighbours=params.neighbours)

    def force(twist: Array, source: PointCloud, target: DistributionMap, params: AlignParams) -> Array:
        return linearise(pose.step(twist), source, slot=slot, target=target, params=params.factor).gradient

    zero = jnp.zeros(6, pose.translation.dtype)
    slope = jax.jacfwd(lambda twist: force(twist, source, target, params))(zero)
    _, change = jax.jvp(lambda *theta: force(zero, *theta), (source, target, params), tuple(tangents[1:]))
    twist = -jnp.linalg.solve(slope, change)
    return pose, jax.jvp(pose.step, (zero,), (twist,))[1]
