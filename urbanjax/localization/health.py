"""Whether a registration can be believed, from its by-products, and what the vehicle does if not."""

import jax.numpy as jnp
import jaxlie
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.localization.types import Health, Sign
from urbanjax.numerics import safe
from urbanjax.registration import Alignment, degeneracy
from urbanjax.types import SHARE, field, pytree, static

CERTAIN = 2.0  # of a sign that only says yes or no, or that is not a number: failure, whatever doubt there is
LARGEST = 1e3  # of a sign: finite, so that scores can be compared
LEAST_INFORMATION = 1e-6  # share of the information, below which a direction counts as having this one
LEVEL = 0.5  # squared part of a direction in the plane, from which on it counts as lying there


@pytree
class HealthParams:
    """Where each sign of failure sets in, and how long each way of going on is trusted."""

    least_share: float = field(default=0.5, metadata=SHARE)  # of points with a correspondence
    most_residual: float = 0.5  # mean squared Mahalanobis distance of pairs, three times that of a good registration
    # share of the information in the plane that the weakest direction has
    least_direction: float = field(default=0.002, metadata=SHARE)
    innovation: float = 0.7  # m from the prediction
    rotation: float = 0.05  # rad, likewise
    growth: float = 0.3  # m per s without registration, by which the innovation may be larger
    spread: float = 0.3  # m between the ends from several starts
    off_lane: float = 2.5  # m from the nearest lane's centre, or from the offset that the camera sees
    lane_age: float = 0.5  # s, after which a lane offset that the camera saw is not known any more
    doubt: float = 0.7  # of a sign, above which a registration does not end a failure unless the pose was searched for
    predict_time: float = 3.0  # s without registration, for which odometry is trusted
    lane_time: float = 20.0  # s, for which it is trusted where the camera sees the lane
    stop_time: float = 10.0  # s without either, after which the vehicle has to stand
    recover: int = static(default=3)  # good registrations in a row that end a failure


@pytree
class Monitor:
    """What the state machine remembers."""

    health: Array  # [] int32, a Health
    failing: Array  # [] s of failed registrations since the last time that all was well
    blind: Array  # [] s of it without anything that could be trusted
    good: Array  # [] int32, good registrations in a row
    searched: Array  # [] bool, the pose was found anew since the last time that all was well


def init(dtype: jnp.dtype | None = None) -> Monitor:
    """The state in which all is well. Args: dtype, of its numbers (default: JAX's)."""
    zero = jnp.zeros((), jnp.zeros(()).dtype if dtype is None else dtype)
    return Monitor(jnp.asarray(Health.NORMAL, jnp.int32), zero, zero, jnp.asarray(0, jnp.int32), jnp.asarray(False))


def signs(
    found: Alignment,
    T_map_predicted: jaxlie.SE3,
    *,
    failing: Float[Array, ""],
    off_lane: Float[Array, ""],
    seen: Bool[Array, ""],
    params: HealthParams,
) -> Float[Array, "8"]:
    """Each Sign as a share of the value at which it means failure; `SPREAD` is left at 0.

    Args: found, the registration; T_map_predicted, from odometry; failing [s], of failed registrations; off_lane [m],
    distance to the lane's centre or to the offset that the camera sees; seen [] bool, there was a scan.
    """
    T_predicted_found = T_map_predicted.inverse() @ found.pose
    distance = safe.norm(T_predicted_found.translation()[:2]) / (params.innovation + params.growth * failing)
    rotation = jnp.abs(T_predicted_found.rotation().log()[2]) / params.rotation
    # The cost is half the sum of squares.
    per_pair = 2 * found.cost / jnp.maximum(found.inliers, 1)
    zero = jnp.zeros_like(distance)
    values = {
        Sign.INLIERS: safe.divide(zero + params.least_share, found.inlier_share, otherwise=jnp.inf),
        Sign.RESIDUAL: per_pair / params.most_residual,
        Sign.WEAKEST: params.least_direction / jnp.maximum(weakest(found), LEAST_INFORMATION),
        Sign.ITERATIONS: jnp.where(found.converged, 0.0, CERTAIN),
        Sign.INNOVATION: jnp.maximum(distance, rotation),
        Sign.SPREAD: zero,
        Sign.LANE: off_lane / params.off_lane,
        Sign.SCAN: jnp.where(seen, 0.0, CERTAIN),
    }
    bounded = jnp.stack([values[sign].astype(distance.dtype) for sign in Sign])
    return jnp.where(jnp.isnan(bounded), CERTAIN, jnp.minimum(bounded, LARGEST))


def weakest(found: Alignment) -> Float[Array, ""]:
    """The smallest share of the translational information, of directions in the plane, that one of them has.

    Args: found, the registration.
    """
    known = degeneracy(found.hessian).translation
    # Directions by how much of them lies in the plane: nothing is asked of the vertical one.
    level = 1 - known.axes[:, 2] ** 2
    return jnp.min(jnp.where(level > LEVEL, known.share, 1.0))


def literal_gate(
    T_map_before: jaxlie.SE3, T_map_after: jaxlie.SE3, *, iterations: int, max_distance: float | Array
) -> Float[Array, ""]:
    """How far Eq. 8, read as a failure test, is met: the step over n_max * eps_corres; failure above 1.

    The paper calls it the condition under which registration succeeds; its direction is that of a failure. It hardly
    ever fires: 64 iterations of 3 m are 192 m, a scan moves 1.7 m. Args: T_map_before and T_map_after, the poses of two
    steps; iterations, n_max; max_distance [m], eps_corres.
    """
    return safe.norm((T_map_before.inverse() @ T_map_after).translation()) / (iterations * max_distance)


def advance(
    now: Monitor,
    score: Float[Array, ""],
    *,
    adrift: Bool[Array, ""],
    has_lane: Bool[Array, ""],
    period: float | Array,
    params: HealthParams,
) -> Monitor:
    """The next state: failure at once, recovery after `recover` good registrations in a row.

    Args: now, the state; score, largest sign of the registration; adrift [] bool, the scan fits neither the map nor the
    last scans, so that the prediction has no ground; has_lane [] bool, the camera sees the lane; period [s] since the
    last step.
    """
    normal = now.health == Health.NORMAL
    failed = score > 1
    doubtful = failed | (~normal & ~now.searched & (score > params.doubt))
    good = jnp.where(doubtful, 0, now.good + 1)
    well = ~doubtful & (normal | (good >= params.recover))
    # A good registration among bad ones does not set the clock back.
    failing = now.failing + jnp.where(doubtful, period, 0.0)
    failing = jnp.where(adrift & failed, jnp.maximum(failing, params.predict_time + period), failing)
    failing = jnp.where(well, 0.0, failing)
    predicts = failing <= params.predict_time
    keeps_lane = has_lane & (failing <= params.lane_time)
    blind = jnp.where(doubtful & ~predicts & ~keeps_lane, now.blind + period, 0.0)
    later = jnp.where(blind <= params.stop_time, Health.RELOCALIZE, Health.STOP)
    health = jnp.where(predicts, Health.PREDICT, jnp.where(keeps_lane, Health.LANE, later))
    return Monitor(
        health=jnp.where(well, Health.NORMAL, health).astype(jnp.int32),
        failing=failing,
        blind=blind,
        good=good.astype(jnp.int32),
        searched=now.searched & ~well,
    )
