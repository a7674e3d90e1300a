"""Finding a lost pose again, from many starts at once; outside the step, since it is rare and heavy."""

import jax
import jax.numpy as jnp
import jaxlie
from jax import Array, lax
from jaxtyping import Float, Int

from urbanjax.localization import health, lidar, motion, sliding
from urbanjax.localization.lidar import LidarLocalizerParams, LidarState
from urbanjax.localization.types import Health
from urbanjax.numerics import safe
from urbanjax.registration import align_starts
from urbanjax.registration.voxelmap import VoxelMap
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.types import POSITIVE, SHARE, Observation, field, pytree, static

WAYS = 8  # sectors of heading that are told apart
WIDE = 8.0  # m between two lane points, from which on there are starts between them
BETWEEN = 4  # parts that such a step is cut into
CELLS = 8192  # along x and y, after which numbers of cells repeat: with the ways they fit into 32 bits


@pytree
class RelocalizeParams:
    """Where a lost vehicle is looked for."""

    # m, of correspondences: wide, since a start may be metres off
    max_distance: float = field(default=4.0, metadata=POSITIVE)
    near: float = 0.5  # m, of correspondences that count in the end
    # of points with a correspondence, below which nothing was found
    least_share: float = field(default=0.6, metadata=SHARE)
    # of the points, by which the best place has to explain more than any other: streets repeat themselves
    margin: float = field(default=0.03, metadata=SHARE)
    apart: float = field(default=1.0, metadata=POSITIVE)  # m, from which on two places are not one
    starts: int = static(default=96)  # K
    finalists: int = static(default=8)  # of them, that are refined
    max_iterations: int = static(default=12)  # of the first round
    at_once: int = static(default=1)  # see registration.align_starts


@pytree
class Relocalization:
    """The best of K starts."""

    pose: jaxlie.SE3  # T_map_body
    found: Array  # [] bool
    share: Array  # [F] inlier shares of the finalists
    start: Array  # [] int32, the one of the K that it came from


def lane_starts(graph: RoadGraph, T_map_body: jaxlie.SE3, *, count: int, spacing: float = 3.0) -> jaxlie.SE3:
    """The K places on lanes nearest to a pose, as stacked poses T_map_body that head along their lanes.

    Of lane points that lie in one cell of `spacing` m and head the same way there is only one: where lanes cross and
    fork, starts would otherwise be spent on one spot. Where lane points are more than `WIDE` m apart there are starts
    between them. Of fewer places than K the nearest stands for those that there are not. Args: graph, the road graph;
    T_map_body, where the vehicle believes to be; count, K; spacing [m].
    """
    middle, heading, there = _lane_points(graph)
    away = jnp.sum((middle - T_map_body.translation()[None, :2]) ** 2, axis=1)
    place = jnp.floor(middle / spacing).astype(jnp.int32)
    way = jnp.floor(heading / (2 * jnp.pi / WAYS) + 0.5).astype(jnp.int32) % WAYS
    cell = ((place[:, 0] % CELLS) * CELLS + place[:, 1] % CELLS) * WAYS + way
    order = jnp.argsort(jnp.where(there, cell, jnp.iinfo(jnp.int32).max), stable=True)
    ordered = cell[order]
    repeated = jnp.zeros(cell.shape, bool).at[order[1:]].set(ordered[1:] == ordered[:-1])
    nearness, near = jax.lax.top_k(-jnp.where(there & ~repeated, away, jnp.inf), min(count, len(away)))
    near = jnp.where(jnp.isfinite(nearness), near, near[0])
    near = jnp.concatenate([near, jnp.broadcast_to(near[0], (count - len(near),))])
    flat = jaxlie.SE2.from_xy_theta(middle[near, 0], middle[near, 1], heading[near])
    return jax.vmap(motion.spatial)(flat)


def _lane_points(graph: RoadGraph) -> tuple[Array, Array, Array]:
    """Points of all lanes: position [P, 2] m, heading [P] rad, and which of them there are [P]."""
    share = jnp.arange(BETWEEN, dtype=graph.centre.dtype) / BETWEEN
    step = graph.centre[:, 1:] - graph.centre[:, :-1]
    turn = graph.heading[:, 1:] - graph.heading[:, :-1]
    turn = jnp.arctan2(jnp.sin(turn), jnp.cos(turn))
    middle = graph.centre[:, :-1, None] + share[None, None, :, None] * step[:, :, None]
    heading = graph.heading[:, :-1, None] + share[None, None, :] * turn[:, :, None]
    wide = safe.norm(step) > WIDE
    there = graph.valid[:, None, None] & (wide[:, :, None] | (share == 0)[None, None, :])
    last = graph.centre[:, -1], graph.heading[:, -1], graph.valid
    shapes = (-1, 2), (-1,), (-1,)
    pairs = zip((middle, heading, there), last, shapes, strict=True)
    position, heading, there = (jnp.concatenate([x.reshape(shape), end]) for x, end, shape in pairs)
    return position, heading, there


def relocalize(
    params: RelocalizeParams,
    localizer: LidarLocalizerParams,
    *,
    world: VoxelMap,
    state: LidarState,
    observation: Observation,
    starts: jaxlie.SE3,
) -> tuple[Relocalization, LidarState]:
    """The pose found from stacked `starts` [K], and the localizer's state with it: good until shown otherwise.

    First all starts with wide correspondences, then the best `finalists` at different places with near ones: best is
    the start whose alignment explains the largest share of the scan, if it does so clearly better than those elsewhere.
    Args: localizer, the parameters of the localizer that lost its way; world, the point-cloud map; state, of that
    localizer; observation, with a scan and odometry; starts [K], stacked poses T_map_body.
    """
    cloud, _ = lidar.cloud_of(localizer, observation)
    centre = state.T_map_body.translation()
    target, _ = sliding.window(world, centre, speed=jnp.asarray(jnp.inf, centre.dtype), params=localizer.sliding)
    factor = localizer.align.factor
    wide = localizer.align.replace(
        factor=factor.replace(max_distance=params.max_distance), max_iterations=params.max_iterations
    )
    rough = align_starts(cloud, target, starts=starts, params=wide, at_once=params.at_once)
    explained = rough.inlier_share - rough.matching_error / params.max_distance
    place = rough.pose.translation()
    best = _distinct(jnp.where(rough.inliers > 0, explained, -jnp.inf), place, params)
    tight = localizer.align.replace(factor=factor.replace(max_distance=params.near))
    fine = align_starts(
        cloud, target, starts=jax.tree.map(lambda x: x[best], rough.pose), params=tight, at_once=params.at_once
    )
    share = jnp.where(fine.converged, fine.inlier_share, 0.0)
    first = jnp.argmax(share)
    T_map_found = jax.tree.map(lambda x: x[first], fine.pose)
    away = safe.norm(fine.pose.translation() - T_map_found.translation()[None])
    second = jnp.max(jnp.where(away > params.apart, share, 0))
    found = (share[first] > params.least_share) & (share[first] - second > params.margin)
    monitor = health.init(centre.dtype)
    monitor = monitor.replace(health=jnp.asarray(Health.PREDICT, jnp.int32), searched=jnp.asarray(True))
    moved = state.replace(T_map_body=T_map_found, monitor=monitor)
    following = jax.tree.map(lambda a, b: jnp.where(found, a, b), moved, state)
    return Relocalization(T_map_found, found, share, best[first]), following


def _distinct(score: Float[Array, " k"], place: Float[Array, "k 3"], params: RelocalizeParams) -> Int[Array, " f"]:
    """The best of the starts that ended at different places; where there are too few, some stand twice."""

    def choose(left: Array, _: None) -> tuple[Array, Array]:
        best = jnp.argmax(left).astype(jnp.int32)
        same = safe.norm(place - place[best][None]) < params.apart
        return jnp.where(same, -jnp.inf, left), best

    return lax.scan(choose, score, length=params.finalists)[1]
