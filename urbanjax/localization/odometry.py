"""LiDAR odometry: edges and planes of each scan against a local map of the last keyframes (the x^L of Eq. 9).

Which is which the covariances of the clouds say (`registration.features`): thin across a plane, or across a line. A
point that is neither is a ball, and weighs a thousandth.
"""

import jax
import jax.numpy as jnp
import jaxlie
from jax import Array, lax

from urbanjax.numerics import safe, symmetric
from urbanjax.registration import Alignment, AlignParams, MapParams, PointCloud, align, build
from urbanjax.registration.linear import FactorParams, Rigid
from urbanjax.types import SHARE, field, pytree, static


@pytree
class OdometryParams:
    """The local map, and when a scan joins it."""

    map: MapParams = MapParams(shape=(208, 208, 24))
    align: AlignParams = AlignParams(factor=FactorParams(max_distance=2.0, kernel="huber"))
    spacing: float = 2.0  # m between keyframes
    rotation: float = 0.15  # rad between keyframes
    # of points with a correspondence, below which a scan does not fit the local map
    least_share: float = field(default=0.4, metadata=SHARE)
    innovation: float = 1.0  # m from the predicted motion, beyond which it does not fit either
    keyframes: int = static(default=5)


@pytree
class OdometryState:
    """K keyframes of F points in the frame of the newest one, so that numbers stay small on long ways."""

    position: Array  # [3, K * F] m
    covariance: Array  # [6, K * F]
    valid: Array  # [K * F] bool
    T_keyframe_body: jaxlie.SE3
    T_start_keyframe: jaxlie.SE3


@pytree
class Odometer:
    """What one step came to."""

    T_before_after: jaxlie.SE3  # of the body (Eq. 9; clouds are in its frame, so nothing is conjugated)
    tracked: Array  # [] bool, the scan fits the local map; if not, the motion is the predicted one
    alignment: Alignment


def init(params: OdometryParams, points: int, dtype: jnp.dtype | None = None) -> OdometryState:
    """The state without any keyframe.

    Args: points, capacity F of the clouds to come; dtype, of its numbers (default: JAX's).
    """
    dtype = jnp.zeros(()).dtype if dtype is None else dtype
    n = params.keyframes * points
    here = jaxlie.SE3.identity().parameters().astype(dtype)
    return OdometryState(
        position=jnp.zeros((3, n), dtype),
        covariance=jnp.zeros((6, n), dtype),
        valid=jnp.zeros(n, bool),
        T_keyframe_body=jaxlie.SE3(here),
        T_start_keyframe=jaxlie.SE3(here),
    )


def step(
    params: OdometryParams, state: OdometryState, cloud: PointCloud, T_before_predicted: jaxlie.SE3
) -> tuple[OdometryState, Odometer]:
    """The motion of the body since the last scan. Pure.

    A scan that does not fit (too few correspondences, or far from the prediction) begins a new local map. Args: state,
    with the local map; cloud, in the body frame at its stamp; T_before_predicted, the motion to expect.
    """
    T_keyframe_predicted = state.T_keyframe_body @ T_before_predicted
    local = PointCloud(state.position, state.covariance, jnp.zeros_like(state.position), state.valid)
    target = build(local, params.map, centre=lax.stop_gradient(T_keyframe_predicted.translation()))
    found = align(cloud, target, start=T_keyframe_predicted, params=params.align)
    innovation = safe.norm((T_keyframe_predicted.inverse() @ found.pose).translation())
    fits = (found.inlier_share > params.least_share) & (innovation < params.innovation) & found.converged
    seen = jnp.any(cloud.valid)
    tracked = fits & seen
    T_keyframe_body = jax.tree.map(lambda a, b: jnp.where(tracked, a, b), found.pose, T_keyframe_predicted)
    moved = safe.norm(T_keyframe_body.translation()) > params.spacing
    rotated = safe.norm(T_keyframe_body.rotation().log()) > params.rotation
    fresh = ~tracked & seen
    valid = state.valid & ~fresh
    joins = seen & (moved | rotated | fresh)
    moved_on = state.replace(T_keyframe_body=T_keyframe_body, valid=valid)
    following = lax.cond(joins, _insert, lambda s, *_: s, moved_on, cloud)
    return following, Odometer(state.T_keyframe_body.inverse() @ T_keyframe_body, tracked, found)


def travelled(state: OdometryState) -> jaxlie.SE3:
    """T_start_body: the whole way since the first scan. Args: state, of the last step."""
    return state.T_start_keyframe @ state.T_keyframe_body


def _insert(state: OdometryState, cloud: PointCloud) -> OdometryState:
    """The state with the scan as newest keyframe in place of the oldest one, all in the new keyframe's frame."""
    T_body_keyframe = state.T_keyframe_body.inverse()
    rigid = Rigid(T_body_keyframe.rotation().as_matrix(), T_body_keyframe.translation())
    n = cloud.valid.shape[0]

    def push(old: Array, new: Array) -> Array:
        return jnp.concatenate([old[..., n:], new], axis=-1)

    return state.replace(
        position=push(rigid.move(state.position), cloud.position),
        covariance=push(symmetric.congruence(rigid.rotation, state.covariance), cloud.covariance),
        valid=push(state.valid, cloud.valid),
        T_start_keyframe=(state.T_start_keyframe @ state.T_keyframe_body).normalize(),
        T_keyframe_body=jaxlie.SE3(jaxlie.SE3.identity().parameters().astype(state.position.dtype)),
    )
