"""The localizer that finds the pose from scans on a point-cloud map, and goes on when that fails (Fig. 3)."""

import jax
import jax.numpy as jnp
import jaxlie
from jax import Array, lax
from jaxtyping import Float

from urbanjax.localization import health, motion, odometry, sliding
from urbanjax.localization.health import HealthParams, Monitor
from urbanjax.localization.odometry import Odometer, OdometryParams, OdometryState
from urbanjax.localization.sliding import SlidingParams
from urbanjax.localization.types import Health, Localization, Sign
from urbanjax.numerics import safe
from urbanjax.registration import (
    Alignment,
    AlignParams,
    CovarianceParams,
    PointCloud,
    PreprocessParams,
    align,
    align_starts,
    preprocess,
)
from urbanjax.registration.distributions import DistributionMap
from urbanjax.registration.downsample import DownsampleParams
from urbanjax.registration.features import FeatureParams
from urbanjax.registration.linear import FactorParams
from urbanjax.registration.voxelmap import VoxelMap
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.roadmap.locate import locate
from urbanjax.types import HANDED_DOWN, Observation, Scan, ScenarioError, field, pytree, static

STARTS = ("predict_on_failure", "always_predict", "previous")
PLANE = (3, 4, 2)  # x, y and heading among a twist's [omega; v]
CAPACITY = 8192  # points of a thinned scan, where none is set
SUSPICIOUS = 0.7  # of a sign, from which on other starts are tried
MARGIN = 2.0  # m, of the map's window beyond the points of the scan
AXLE_HEIGHT = 0.33  # m, of the centre of the rear axle, the body frame, above the ground
START_COVARIANCE = (0.1, 0.1, 0.01)  # m^2, m^2, rad^2, before the first scan
DRIFT_SHARES = (1.0, 1.0, 0.01)  # m^2, m^2, rad^2: variances that a drift of 1 adds in 1 m, a tenth of it in rad
AROUND = ((0.6, 0.0, 0.0), (-0.6, 0.0, 0.0), (0.0, 0.5, 0.02), (0.0, -0.5, -0.02))  # m, m, rad


@pytree
class LidarLocalizerParams:
    """From a scan to a pose."""

    mount: tuple[float, float, float, float] = field(
        default=None, metadata=HANDED_DOWN
    )  # of the LiDAR: x, y, z (m) above the ground, yaw (rad)
    period: float = field(default=None, metadata=HANDED_DOWN)  # s, between two steps
    preprocess: PreprocessParams = PreprocessParams(
        downsample=DownsampleParams(resolution=0.8), features=FeatureParams(edges=True)
    )
    sensing_radius: float = 100.0  # m in the plane, beyond which points of a scan are too sparse to help (Table I)
    sliding: SlidingParams = SlidingParams()
    align: AlignParams = AlignParams(
        factor=FactorParams(max_distance=3.0, kernel="huber"),
        covariance=CovarianceParams(floor_translation=4e-3),  # calibrated in experiments.register
        max_iterations=30,
    )
    odometry: OdometryParams = OdometryParams()
    health: HealthParams = HealthParams()
    drift: float = 0.01  # standard deviation that odometry adds in 1 m: so many m, and a tenth of it in rad
    start: str = static(default="always_predict", metadata={"choices": STARTS})  # of a registration (Eq. 9-10)
    fallback: bool = static(default=True)  # the prediction replaces a failed registration

    @property
    def capacity(self) -> int:
        """Points of a thinned scan: known before the first one, whatever it holds."""
        stated = self.preprocess.downsample.capacity
        return CAPACITY if stated is None else stated

    @property
    def sized(self) -> PreprocessParams:
        """How a scan is prepared, with that capacity."""
        return self.preprocess.replace(downsample=self.preprocess.downsample.replace(capacity=self.capacity))


@pytree
class LidarState:
    """What the localizer carries from scan to scan."""

    T_map_body: jaxlie.SE3
    covariance: Array  # [3, 3] of (x, y, heading) in the body frame
    odometry: OdometryState
    monitor: Monitor
    started: Array  # [] bool, there was a step before


@pytree
class LidarInfo:
    """By-products of one step."""

    signs: Array  # [8], see Sign: failure above 1
    failed: Array  # [] bool
    reason: Array  # [] int32, the largest Sign
    T_map_predicted: jaxlie.SE3  # Eq. 10
    T_start_body: jaxlie.SE3  # of odometry alone
    alignment: Alignment
    tracked: Array  # [] bool, odometry found the scan to fit
    literal_gate: Array  # [] Eq. 8, failure above 1
    dropped: Array  # [2] voxels without a place: of the scan, of the map's window


def init(params: LidarLocalizerParams, T_map_body: jaxlie.SE2) -> LidarState:
    """The state before the first scan. Args: T_map_body, of the rear axle at that scan, within half a metre."""
    dtype = T_map_body.translation().dtype
    return LidarState(
        T_map_body=motion.spatial(T_map_body),
        covariance=jnp.diag(jnp.array(START_COVARIANCE, dtype)),
        odometry=odometry.init(params.odometry, params.capacity, dtype),
        monitor=health.init(dtype),
        started=jnp.asarray(False),
    )


def points_of(params: LidarLocalizerParams, observation: Observation) -> tuple[Float[Array, "n 3"], Array]:
    """The scan's points [N, 3] (m) in the body frame at its stamp, without the sweep's motion, and which of them count.

    Raises ScenarioError (when traced) if the observation has no scan. Args: observation, with a scan and odometry.
    """
    scan = observation.scan
    if not isinstance(scan, Scan):
        raise ScenarioError("localizer 'lidar' needs observation.scan; give it, or choose another localizer")
    x, y, z, yaw = (jnp.asarray(value, scan.position.dtype) for value in params.mount)
    rotation, translation = jaxlie.SO3.from_z_radians(yaw), jnp.stack([x, y, z - AXLE_HEIGHT])
    T_body_lidar = jaxlie.SE3.from_rotation_and_translation(rotation, translation)
    points = motion.deskew(scan, T_body_lidar, odometry=observation.odometry)
    # Beyond the window of the map a point could not be explained, and would count against the registration.
    reach = jnp.minimum(params.sensing_radius, sliding.radius(observation.odometry.speed, params.sliding) - MARGIN)
    near = points[:, 0] ** 2 + points[:, 1] ** 2 < reach**2
    return points, scan.valid.reshape(-1) & near


def cloud_of(params: LidarLocalizerParams, observation: Observation) -> tuple[PointCloud, Array]:
    """The scan as a cloud with features, and how many voxels found no place in it. Errors as of `points_of`.

    Args: observation, with a scan and odometry.
    """
    cloud, info = preprocess(*points_of(params, observation), params=params.sized)
    return cloud, info.dropped


def step(
    params: LidarLocalizerParams, world: VoxelMap, graph: RoadGraph | None, state: LidarState, observation: Observation
) -> tuple[Localization, LidarState]:
    """The pose at the stamp of the scan, and the next state. Pure; the gradient is that of the registration.

    Raises ScenarioError (when traced) if the observation has no scan. Args: world, the point-cloud map; graph, the road
    graph, for the lane that an observed lane offset belongs to (None: no lane is known); state, of the step before;
    observation, with scan and odometry, and the lane offset if there is a camera.
    """
    with jax.named_scope("preprocess"):
        cloud, dropped = cloud_of(params, observation)
        seen = jnp.sum(cloud.valid) >= params.preprocess.features.neighbours
    with jax.named_scope("odometry"):
        T_before_wheels = motion.travelled(observation.odometry, jnp.where(state.started, params.period, 0.0))
        tracking, odometer = odometry.step(params.odometry, state.odometry, cloud, T_before_wheels)
        T_map_predicted = (state.T_map_body @ odometer.T_before_after).normalize()
    with jax.named_scope("window"):
        target, missed = sliding.window(
            world, T_map_predicted.translation(), speed=observation.odometry.speed, params=params.sliding
        )
    with jax.named_scope("registration"):
        found = align(cloud, target, start=_start(params, state, T_map_predicted), params=params.align)
    with jax.named_scope("health"):
        lane = observation.lane_offset
        has_lane = jnp.asarray(False) if lane is None or graph is None else lane.known(params.health.lane_age)
        aside = off_lane(
            graph,
            T_map_predicted if params.fallback else found.pose,
            expected=0.0 if lane is None else jnp.where(has_lane, lane.offset, 0.0),
        )
        signs = health.signs(
            found,
            T_map_predicted,
            failing=state.monitor.failing,
            off_lane=jnp.abs(aside),
            seen=seen,
            params=params.health,
        )
        signs = _with_spread(params, signs, cloud, target, found)
        score = jnp.max(signs)
        failed, adrift = score > 1, seen & ~odometer.tracked
        monitor = health.advance(
            state.monitor, score, adrift=adrift, has_lane=has_lane, period=params.period, params=params.health
        )
    T_map_carried = _keep_lane(graph, T_map_predicted, aside, monitor.health == Health.LANE)
    use = ~failed if params.fallback else jnp.asarray(True)
    T_map_body = jax.tree.map(lambda a, b: jnp.where(use, a, b), found.pose, T_map_carried)
    covariance = jnp.where(
        use,
        found.covariance[jnp.ix_(jnp.array(PLANE), jnp.array(PLANE))],
        _carried(params, state, odometer),
    )
    info = LidarInfo(
        signs=signs,
        failed=failed,
        reason=jnp.argmax(signs).astype(jnp.int32),
        T_map_predicted=T_map_predicted,
        T_start_body=odometry.travelled(tracking),
        alignment=found,
        tracked=odometer.tracked,
        literal_gate=health.literal_gate(
            state.T_map_body,
            found.pose,
            iterations=params.align.max_iterations,
            max_distance=params.align.factor.max_distance,
        ),
        dropped=jnp.stack([dropped, missed]),
    )
    following = LidarState(T_map_body.normalize(), covariance, tracking, monitor, jnp.asarray(True))
    return Localization(motion.planar(T_map_body), covariance, monitor.health, info), following


def _start(params: LidarLocalizerParams, state: LidarState, T_map_predicted: jaxlie.SE3) -> jaxlie.SE3:
    """Where the registration begins: T_t-1, or T_pred of Eq. 10, always or after a failure."""
    if params.start == "previous":
        return state.T_map_body
    if params.start == "always_predict":
        return T_map_predicted
    well = state.monitor.health == Health.NORMAL
    return jax.tree.map(lambda a, b: jnp.where(well, a, b), state.T_map_body, T_map_predicted)


def _with_spread(
    params: LidarLocalizerParams,
    signs: Float[Array, "8"],
    cloud: PointCloud,
    target: DistributionMap,
    found: Alignment,
) -> Float[Array, "8"]:
    """The signs with SPREAD: where other starts end. Looked at only if another sign is not far from failure."""

    def spread() -> Array:
        around = jnp.array(AROUND, signs.dtype)
        flat = jaxlie.SE2.from_xy_theta(around[:, 0], around[:, 1], around[:, 2])
        starts = jax.vmap(lambda pose, off: pose @ motion.spatial(off), in_axes=(None, 0))(found.pose, flat)
        ends = align_starts(cloud, target, starts=starts, params=params.align).pose.translation()
        return jnp.max(safe.norm(ends - found.pose.translation()[None]))

    suspicious = (jnp.max(signs) > SUSPICIOUS) & (jnp.max(signs) <= 1)
    value = lax.cond(suspicious, spread, lambda: jnp.zeros((), signs.dtype))
    return signs.at[Sign.SPREAD].set(value / params.health.spread)


def off_lane(graph: RoadGraph | None, T_map_body: jaxlie.SE3, *, expected: Array | float) -> Float[Array, ""]:
    """How far the pose is left of where it should be in its lane [m].

    The alarm of the paper's resilience: 0 without a road graph. Args: graph, the road graph or None; T_map_body;
    expected [] m, the offset from the lane's centre that the camera saw, or 0 where it is not known.
    """
    if graph is None:
        return jnp.zeros((), T_map_body.translation().dtype)
    flat = motion.planar(T_map_body)
    lane = locate(graph, flat.translation()[None], heading=flat.rotation().as_radians()[None])
    return lane.offset[0] - expected


def _keep_lane(graph: RoadGraph | None, T_map_body: jaxlie.SE3, aside: Array, keeps: Array) -> jaxlie.SE3:
    """The pose moved sideways onto the lane offset that the camera sees."""
    if graph is None:
        return T_map_body
    flat = motion.planar(T_map_body)
    heading = flat.rotation().as_radians()
    lane = locate(graph, flat.translation()[None], heading=heading[None])
    along = heading - lane.heading_error[0]
    left = jnp.stack([-jnp.sin(along), jnp.cos(along), jnp.zeros_like(along)])
    translation = T_map_body.translation() + jnp.where(keeps & lane.valid[0], -aside, 0.0) * left
    return jaxlie.SE3.from_rotation_and_translation(T_map_body.rotation(), translation)


def _carried(params: LidarLocalizerParams, state: LidarState, odometer: Odometer) -> Float[Array, "3 3"]:
    """The covariance after a step of odometry."""
    T_before_after = motion.planar(odometer.T_before_after)
    adjoint = T_before_after.inverse().adjoint()
    way = safe.norm(T_before_after.translation())
    grown = params.drift**2 * way * jnp.diag(jnp.array(DRIFT_SHARES, way.dtype))
    return jnp.linalg.multi_dot([adjoint, state.covariance, adjoint.T], precision=lax.Precision.HIGHEST) + grown
