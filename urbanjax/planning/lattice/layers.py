"""The lattice that macro planning searches: its nodes, and what nodes and edges cost (Eq. 13-14)."""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jaxtyping import Float, Int

from urbanjax.geometry import frenet
from urbanjax.numerics import lean, safe, soft
from urbanjax.numerics.kept import recomputed
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning.clearance import Passage
from urbanjax.planning.costs import BARRIERS, CURVATURE_ROUNDING, barrier, smooth_abs
from urbanjax.planning.cross_section import CrossSections, bars, boundaries, covered
from urbanjax.planning.lattice.edges import (
    CORNER,
    EdgeLimits,
    Edges,
    Steps,
    join,
    layers_of,
    refused,
    sharpest,
    steps_along,
)
from urbanjax.planning.nearest import nearest
from urbanjax.planning.previous import Previous, profile
from urbanjax.types import SOFT, Prediction, pytree, static
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.params import VehicleParams

MACRO_TERMS = (
    "length",
    "obstacle",
    "curvature",
    "transition",
    "route",
    "centre",
    "lane_change",
    "oncoming",
    "line",
    "collision",
    "forbidden",
)


@pytree
class LatticeWeights:
    """What a plan pays, in metres of detour (length has weight 1), and what it may not do."""

    PINNED: ClassVar[dict[str, str]] = {
        # The weight of length is 1 by construction, so none of these is pinned for their unit.
        "collision": "safety: the price of a collision",
        "forbidden": "safety: the price of leaving the road and of breaking a limit",
        "line": "safety: the price of a line that may not be crossed",
        "max_slope": "safety: what an edge may not exceed",
        "lateral_speed": "safety: what an edge may not exceed",
        "*_scale": SOFT,
    }

    obstacle: float = 1.0  # per m^2 of missing clearance and m of way
    clearance: float = 0.8  # m, below which clearance is missing
    curvature: float = 1.0  # per rad of turn
    transition: float = 0.05  # per m beside the previous plan and m of way
    route: float = 0.05  # per m beside the route's lane and m of way
    centre: float = 0.1  # per m beside the centre of the lane and m of way
    lane_change: float = 2.0  # per change
    oncoming: float = 0.1  # per m of way in the oncoming lane
    line: float = 5.0  # per m of the footprint over a line that may not be crossed, and m of way
    collision: float = 500.0  # per colliding node: the least collisions, but
    forbidden: float = 2e4  # per node off the road, and per step that breaks a limit or crosses such a line: never
    max_slope: float = 0.4  # of the path against the lane
    lateral_speed: float = 3.0  # m/s
    collision_scale: float = 0.2  # m, gap that clearly is no collision
    slope_scale: float = 0.02  # slope that clearly is too steep
    line_scale: float = 0.5  # m, clearly across the line between two lanes
    edges: EdgeLimits = EdgeLimits()
    barrier: str = static(default="hinge", metadata={"choices": BARRIERS})


@pytree
class Lattice:
    """Nodes in S layers of M = Q * r, from right to left, with the road and the assumed profile at each layer."""

    offset: Array  # [S, M] m
    lane: np.ndarray  # [M] int, lane across that a node belongs to
    road: CrossSections  # at the S layers
    station: Array  # [S] m
    spacing: Array  # [] m
    time: Array  # [S] s, of arrival
    speed: Array  # [S] m/s
    step_time: Array  # [S] s, from the layer before
    steps: Steps  # to each layer from the one before


def node_offsets(road: CrossSections, nodes_per_lane: int) -> tuple[Float[Array, "n m"], Int[np.ndarray, "m"]]:
    """Offsets [n, M] (m) of Q * r nodes from right to left, and the lane across [M] that each belongs to.

    Nodes are spread evenly over each lane, so that with lanes side by side they are even across the road. Args: road,
    at n stations; nodes_per_lane, r.
    """
    r = nodes_per_lane
    lanes = road.lane_offset.shape[1]
    within = ((np.arange(r) - (r - 1) / 2) / r).astype(road.lane_offset.dtype)
    offset = road.lane_offset[:, :, None] + road.lane_width[:, :, None] * within[None, None, :]
    return offset.reshape(-1, lanes * r), np.repeat(np.arange(lanes, dtype=np.int32), r)


def build(road: CrossSections, speed: Float[Array, "k"], *, time: Float[Array, "k"], nodes_per_lane: int) -> Lattice:
    """The lattice ahead.

    Args: road, at the fine stations of S steps from the ego's own station on; speed m/s and time s [S + 1], at the ends
    of those steps; nodes_per_lane.
    """
    layers = layers_of(road, CORNER)
    spacing = jnp.broadcast_to(layers.station[1] - layers.station[0], (speed.shape[0] - 1,))
    ahead = jax.tree.map(lambda x: x[1:], layers)
    offset, lane = node_offsets(ahead, nodes_per_lane)
    return Lattice(
        offset=offset,
        lane=lane,
        road=ahead,
        station=ahead.station,
        spacing=spacing[0],
        time=time[1:],
        speed=speed[1:],
        step_time=jnp.diff(time),
        steps=steps_along(road, spacing, profile=CORNER),
    )


def clearance(
    lattice: Lattice, driving: Driving, *, prediction: Prediction, follower: Float[Array, "b"]
) -> Float[Array, "s m"]:
    """Smallest gap [S, M] (m) from the ego's box at each node, when it arrives there, to any predicted box.

    Args: lattice; driving, with ClearanceParams; prediction, of everybody else; follower [B], degree to which an object
    does not count.
    """
    road, shape = lattice.road, lattice.offset.shape

    def each(layer: Array) -> Array:
        return jnp.broadcast_to(layer[:, None], shape).reshape(-1)

    heading = each(road.heading)
    line = frenet.Reference(jnp.repeat(road.position, shape[1], axis=0), heading, each(road.curvature))
    passage = Passage(
        position=frenet.to_world(line, lattice.offset.reshape(-1)),
        heading=heading,
        time=each(lattice.time),
        step=each(jnp.broadcast_to(lattice.spacing, shape[:1])),
        step_time=each(lattice.step_time),
    )
    return nearest(passage, driving, prediction=prediction, ignored=follower).reshape(shape)


def centred(lattice: Lattice, weights: LatticeWeights, *, room: Float[Array, "s m"]) -> tuple[Lattice, Array]:
    """The lattice with nodes that lack clearance moved to where they have most, and the clearance [S, M] (m) there.

    By at most half the way to the next node, so that a gap between two nodes is met in its middle: clearance rises and
    falls by a metre per metre across, which tells its peak from that of the nodes beside. A node that would collide
    there too stays. Args: lattice; weights, for the clearance that is enough; room [S, M] m, clearance of each node.
    """
    right = jnp.concatenate([room[:, :1], room[:, :-1]], axis=1)
    left = jnp.concatenate([room[:, 1:], room[:, -1:]], axis=1)
    apart = lattice.road.lane_width[:, lattice.lane] * (lattice.road.lane_width.shape[1] / lattice.lane.size)
    reach = lean.minimum(lean.maximum(weights.clearance - room, 0), apart / 2)
    shift = lean.minimum(lean.maximum((left - right) / 2, -reach), reach)
    peak = lean.minimum(right + apart + shift, left + apart - shift)
    there = lean.minimum(room + jnp.abs(shift), peak)
    helps = there > 0
    return lattice.replace(offset=lattice.offset + jnp.where(helps, shift, 0)), jnp.where(helps, there, room)


def node_terms(
    lattice: Lattice, driving: Driving, *, room: Float[Array, "s m"], previous: Previous
) -> tuple[dict[str, Array], Float[Array, "s m"]]:
    """Weighted cost [S, M] of each node by name (Eq. 13), and the degree [S, M] to which it is forbidden.

    Every term is multiplied by the layer spacing, so that weights do not depend on the resolution. Args: lattice;
    driving, with LatticeWeights; room [S, M] m, clearance of each node; previous, the plan of the step before.
    """
    vehicle, weights, relaxation = driving.vehicle, driving.params, driving.relaxation
    road, offset, ds = lattice.road, lattice.offset, lattice.spacing
    covers = covered(offset, vehicle.width / 2, road=road) * road.present[:, None, :]
    over = bars(road, lattice.lane, end=np.arange(road.barred.shape[1]))
    missing = vehicle.width - jnp.sum(covers, axis=-1) + 1 - road.present[:, lattice.lane]
    off_road = soft.above(missing, weights.edges.tolerance, relaxation, scale=weights.edges.edge_scale)
    collides = soft.above(-room, 0.0, relaxation, scale=weights.collision_scale)
    last, counts = profile(previous, lattice.station)
    route = road.lane_offset[:, road.lane_offset.shape[1] // 2]
    turn = road.curvature[:, None] / frenet.scale(road.curvature[:, None], offset)
    opposed = jnp.sum(covers * road.oncoming[:, None, :], axis=-1) / vehicle.width
    return {
        "obstacle": weights.obstacle * ds * barrier(room, weights.clearance, kind=weights.barrier),
        "curvature": weights.curvature * ds * smooth_abs(turn, CURVATURE_ROUNDING),
        "transition": weights.transition * ds * smooth_abs(offset - last[:, None]) * counts[:, None],
        "route": weights.route * ds * smooth_abs(offset - route[:, None]),
        "centre": weights.centre * ds * smooth_abs(offset - road.lane_offset[:, lattice.lane]),
        "oncoming": weights.oncoming * ds * opposed,
        "line": weights.line * ds * jnp.sum(covers * over, axis=-1),
        "collision": weights.collision * collides,
        "forbidden": weights.forbidden * off_road,
    }, soft.either(off_road, collides)


def ways(lattice: Lattice, offset: Float[Array, ""], *, vehicle: VehicleParams) -> Edges:
    """All edges [S, M, M] to each layer from the one before.

    Args: lattice; offset [] m, the ego's own, from which those to the first layer begin; vehicle.
    """
    own = jnp.broadcast_to(offset, lattice.offset[:1].shape)
    offsets = (jnp.concatenate([own, lattice.offset[:-1]]), lattice.offset)

    @recomputed
    def edges(ends: tuple[Array, Array], steps: Steps, vehicle: VehicleParams) -> Edges:
        return join(ends, jax.tree.map(jnp.zeros_like, ends), steps=steps, profile=CORNER, vehicle=vehicle)

    return edges(offsets, lattice.steps, vehicle)


def edge_terms(lattice: Lattice, driving: Driving, *, ways: Edges) -> tuple[dict[str, Array], Float[Array, "e m m"]]:
    """Weighted cost [S-1, M, M] of each edge by name, and the degree to which it is forbidden.

    An edge is as long as it is along its own offset curve, and is forbidden where it is too sharp or leaves the road;
    the reference line's own bends are never too sharp. Args: lattice; driving, with LatticeWeights; ways, its edges.
    """
    weights, relaxation = driving.params, driving.relaxation
    ways = jax.tree.map(lambda x: x[1:], ways)
    bends = safe.maximum(jnp.abs(lattice.steps.curvature[1:]), 1)[:, None, None]
    beyond = refused(
        ways, lean.maximum(sharpest(driving.vehicle, weights.edges), bends), limits=weights.edges, relaxation=relaxation
    )
    across = lattice.offset[1:, None, :] - lattice.offset[:-1, :, None]
    crossed = abs(lattice.lane[:, None] - lattice.lane[None, :]).astype(across.dtype)
    barred = bars(jax.tree.map(lambda x: x[1:], lattice.road), lattice.lane, end=lattice.lane)
    steep = _too_steep(across, lattice.spacing, lattice.speed[1:, None, None], weights, relaxation)
    bad = soft.either(soft.either(barred, steep), beyond)
    return {
        "length": ways.detour,
        "lane_change": jnp.broadcast_to(weights.lane_change * crossed[None], across.shape),
        "forbidden": weights.forbidden * bad,
    }, bad


def start_terms(
    lattice: Lattice, driving: Driving, *, ways: Edges, offset: Float[Array, ""]
) -> tuple[dict[str, Array], Float[Array, "m"]]:
    """Weighted cost [M] of the edges from the ego to the first layer, and the forbidden degree.

    Args: lattice; driving, with LatticeWeights; ways, its edges; offset [] m, of the ego.
    """
    weights, relaxation = driving.params, driving.relaxation
    first = jax.tree.map(lambda x: x[:1], lattice.road)
    lines = boundaries(first)[0]
    # The ego's lane, as weights: the degree to which it is left of each line, less that of the next one.
    left_of = soft.above(offset - lines, 0.0, relaxation, scale=weights.line_scale)
    own = lax.pad(left_of, 1.0, [(1, 0, 0)]) - lax.pad(left_of, 0.0, [(0, 1, 0)])
    lanes = np.arange(own.shape[0])
    crossed = own @ abs(lanes[:, None] - lattice.lane[None, :]).astype(offset.dtype)
    across = lattice.offset[0] - offset
    bad = soft.either(
        own @ bars(first, lanes, end=lattice.lane)[0],
        _too_steep(across, lattice.spacing, lattice.speed[0], weights, relaxation),
    )
    return {
        "length": ways.detour[0, 0],
        "lane_change": weights.lane_change * crossed,
        "forbidden": weights.forbidden * bad,
    }, bad


def _too_steep(across: Array, along: Array, speed: Array, weights: LatticeWeights, relaxation: Relaxation) -> Array:
    """Degree to which a step's slope is beyond the geometric limit or the lateral speed."""
    limit = lean.minimum(weights.max_slope, weights.lateral_speed / speed)
    return soft.above(jnp.abs(across) / along - limit, 0.0, relaxation, scale=weights.slope_scale)
