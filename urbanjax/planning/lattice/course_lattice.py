"""The state lattice of a whole course, built once from its corridor and independent of the ego (IV-C.3, Fig. 4).

Layers lie closer in bends than on straights. A window slides over it with static shapes, as over the corridor.
Macro planning builds its own layers by the same rules (`lattice.node_offsets`, `edges.join`) from the ego's station on.
"""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import soft
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning import shape
from urbanjax.planning.cross_section import CrossSections, bars, cross_sections, drivable
from urbanjax.planning.lattice import edges
from urbanjax.planning.lattice.edges import QUINTIC, EdgeLimits
from urbanjax.planning.lattice.layers import node_offsets
from urbanjax.roadmap.corridor import Corridor
from urbanjax.roadmap.progress import to_world
from urbanjax.types import RoadError, pytree, static
from urbanjax.vehicle.params import VehicleParams

SAME_PLACE, SAME_WAY = 1.0, 0.99  # m, and cosine of the angle, within which a course is back where it began
BENDY = 0.3  # of the threshold of curvature, over which layers draw together
LARGEST = 20_000_000  # edges of one lattice


@pytree
class CourseLatticeParams:
    """Where layers and nodes of a course lie, and which of them may be joined."""

    straight_spacing: float = 20.0  # m, between layers
    bend_spacing: float = 8.0  # m
    bend_curvature: float = 0.01  # 1/m, above which the reference line bends
    lateral_spacing: float = 0.75  # m, at most, between nodes
    max_slope: float = 0.4  # of an edge against the reference line, on average
    slope_scale: float = 0.02  # slope that clearly is too steep
    limits: EdgeLimits = EdgeLimits(tolerance=0.0)
    n_layers: int = static(default=64)  # S
    nodes_per_lane: int = static(default=5)  # r
    closed: bool = static(default=False)  # the last layer leads to the first one


@pytree
class CourseLattice:
    """S layers of M = Q * r nodes from right to left, and from each layer the edges to the next one.

    Headings and curvatures are those of the curves that all edges of a node share, so paths are smooth in the plane.
    The last layer leads to the first where the course is closed; elsewhere its edges are none, with `edge` 0.
    """

    station: Array  # [S] m along the reference line
    spacing: Array  # [S] m, to the next layer; the last one of an open course as the one before
    position: Array  # [S, M, 2] m
    heading: Array  # [S, M] rad
    curvature: Array  # [S, M] 1/m
    offset: Array  # [S, M] m, left positive
    slope: Array  # [S, M] d' of the lane there
    lane: Array  # [S, M] int, lane across
    oncoming: Array  # [S, M] degree, in a lane against the route
    node: Array  # [S, M] degree to which the node is there: a lane with room for the vehicle
    edge: Array  # [S, M, M] degree to which the edge from row to column is there
    length: Array  # [S, M, M] m, along the edge
    greatest: Array  # [S, M, M] 1/m, greatest curvature along it
    bending: Array  # [S, M, M] 1/m, integral of the squared curvature
    course: Array  # [] m, length of the reference line
    closed: bool = static(default=False)


@pytree
class SlideParams:
    """The part of a course's lattice that is looked at."""

    behind: float = 50.0  # m, how much of it lies behind
    n_layers: int = static(default=32)  # W


def sized(corridor: Corridor, params: CourseLatticeParams) -> CourseLatticeParams:
    """`params` with the layers, nodes and closure that the spacings ask for (host side).

    Layers come in multiples of 16, so that courses of similar length share one compiled program; a course is closed
    where it ends at the pose it began with. Raises RoadError on impossible spacings and on a lattice too large to hold.
    Args: corridor, of the whole course.
    """
    spacings = (params.straight_spacing, params.bend_spacing, params.bend_curvature, params.lateral_spacing)
    if not all(math.isfinite(float(x)) and float(x) > 0 for x in spacings):
        raise RoadError(f"spacings and bend_curvature must be positive, not {[float(x) for x in spacings]}")
    closed = _is_loop(corridor)
    count = float(_counted(corridor, params)[-1])
    n_layers = max(-(-math.ceil(count + (not closed)) // 16) * 16, 16)
    widest = float(np.max(np.where(corridor.has_lane, corridor.lane_width, 0)))
    nodes = max(math.ceil(widest / float(params.lateral_spacing)), 1)
    size = n_layers * (nodes * corridor.lane_offset.shape[1]) ** 2
    if size > LARGEST:
        raise RoadError(f"the lattice would have {size} edges, more than {LARGEST}: raise its spacings")
    return params.replace(n_layers=n_layers, nodes_per_lane=nodes, closed=closed)


def build(
    corridor: Corridor, vehicle: VehicleParams, *, params: CourseLatticeParams, relaxation: Relaxation
) -> CourseLattice:
    """The lattice of a course; pure, of static size (see `sized`).

    An edge is there if both its nodes are, no line between them is one that may not be crossed, and its curve is
    neither too steep nor too sharp and stays on the road. Args: corridor, of the whole course; vehicle; relaxation, of
    the degrees.
    """
    if params.n_layers < 2 or params.nodes_per_lane < 1:
        raise RoadError(f"a lattice has 2 layers or more and 1 node per lane or more, not {params}")
    ends = _stations(corridor, params)
    fine = cross_sections(corridor, edges.fine_stations(ends, QUINTIC))
    road, spacing = edges.layers_of(fine, QUINTIC), jnp.diff(ends)
    offset, lane = node_offsets(road, params.nodes_per_lane)
    slope = _slopes(fine, params)
    node = _nodes(road, offset, lane, vehicle, params, relaxation)
    joined = edges.join(
        (offset[:-1], offset[1:]),
        (slope[:-1], slope[1:]),
        steps=edges.steps_along(fine, spacing, profile=QUINTIC),
        profile=QUINTIC,
        vehicle=vehicle,
    )
    steep = jnp.abs(offset[1:, None, :] - offset[:-1, :, None]) / spacing[:, None, None] - params.max_slope
    off = soft.either(
        edges.refused(joined, edges.sharpest(vehicle, params.limits), limits=params.limits, relaxation=relaxation),
        soft.above(steep, 0.0, relaxation, scale=params.slope_scale),
    )
    permitted = 1 - bars(jax.tree.map(lambda x: x[1:], road), lane, end=lane)
    there = node[:-1, :, None] * node[1:, None, :] * permitted * (1 - off)
    heading, curvature = shape.to_plane(road.heading[:, None], road.curvature[:, None], offset, slope, 0 * slope)
    left = jnp.stack([-jnp.sin(road.heading), jnp.cos(road.heading)], axis=-1)
    position = road.position[:, None, :] + offset[..., None] * left[:, None, :]
    size = params.n_layers
    whole = {
        "edge": there,
        "length": spacing[:, None, None] + joined.detour,
        "greatest": joined.curvature,
        "bending": joined.bending,
        "spacing": spacing,
    }
    if not params.closed:
        whole = {name: jnp.concatenate([x, x[-1:]]) for name, x in whole.items()}
        whole["edge"] = whole["edge"].at[-1].set(0)
    return CourseLattice(
        station=ends[:size],
        position=position[:size],
        heading=heading[:size],
        curvature=curvature[:size],
        offset=offset[:size],
        slope=slope[:size],
        lane=jnp.broadcast_to(lane[None], offset[:size].shape),
        oncoming=road.oncoming[:size, lane],
        node=node[:size],
        course=corridor.length,
        closed=params.closed,
        **whole,
    )


def slide(lattice: CourseLattice, station: Float[Array, ""], *, params: SlideParams) -> CourseLattice:
    """The W layers from the last one `behind` metres behind a station on; piecewise constant in the station.

    A closed course goes on beyond its end: stations then rise by its length from lap to lap, so that they are those of
    the lap that `station` is on. At the ends of an open course, its first or last W layers. Args: lattice, of the
    whole course; station [] m.
    """
    size, n = lattice.station.shape[0], params.n_layers
    if n > size:
        raise RoadError(f"a window of {n} layers is longer than the lattice's {size}: lower n_layers")
    begin = station - params.behind
    laps = jnp.floor(begin / lattice.course) if lattice.closed else jnp.zeros_like(begin)
    first = jnp.sum(lattice.station <= begin - laps * lattice.course) - 1
    first = first if lattice.closed else jnp.clip(first, 0, size - n)
    index = first + jnp.arange(n)
    lap = laps + jnp.floor_divide(index, size)
    index = jnp.mod(index, size)
    cut = {name: getattr(lattice, name)[index] for name in lattice.__dataclass_fields__ if name not in WHOLE}
    return lattice.replace(**cut | {"station": cut["station"] + lap * lattice.course})


WHOLE = ("course", "closed")  # what a window has of the whole course


def _is_loop(corridor: Corridor) -> bool:
    """Whether the course ends at the pose with which it began."""
    start = np.asarray(corridor.position[0]), float(corridor.heading[0])
    station = corridor.length[None]
    end, heading, _ = to_world(corridor, station, offset=jnp.zeros_like(station))
    away = float(np.linalg.norm(np.asarray(end[0]) - start[0]))
    back = away < SAME_PLACE and math.cos(float(heading[0]) - start[1]) > SAME_WAY
    return back and float(corridor.length) > SAME_PLACE  # a shorter course has not left


def _counted(corridor: Corridor, params: CourseLatticeParams) -> Float[Array, "n"]:
    """How many layers the spacings ask for up to each station of the course, [N]."""
    bend = (jnp.abs(corridor.curvature) / params.bend_curvature - 1) / BENDY + 0.5
    density = 1 / params.straight_spacing + jnp.clip(bend, 0, 1) * (
        1 / params.bend_spacing - 1 / params.straight_spacing
    )
    part = jnp.clip(corridor.length - corridor.station[:-1], 0, corridor.spacing)
    return jnp.pad(jnp.cumsum(0.5 * (density[1:] + density[:-1]) * part), (1, 0))


def _stations(corridor: Corridor, params: CourseLatticeParams) -> Float[Array, "s"]:
    """Stations (m) of the layers, at equal counts; of a closed course also its end, where the first layer is again."""
    counted = _counted(corridor, params)
    steps = params.n_layers if params.closed else params.n_layers - 1
    share = jnp.arange(steps + 1).astype(counted.dtype) / steps
    end = jnp.minimum(corridor.length, corridor.station[-1])
    return jnp.minimum(jnp.interp(share * counted[-1], counted, corridor.station), end).at[-1].set(end)


def _slopes(fine: CrossSections, params: CourseLatticeParams) -> Float[Array, "s m"]:
    """Slope d' [S, M] of each node's lane line at the layers, from its offsets at the fine stations beside them."""
    line, _ = node_offsets(fine, params.nodes_per_lane)
    parts = QUINTIC.shares.size - 1
    before = jnp.concatenate([line[-2:-1], line[parts - 1 :: parts]])
    after = jnp.concatenate([line[1::parts], line[1:2]])
    to = jnp.concatenate([fine.station[-1:] - fine.station[-2:-1], jnp.diff(fine.station)[parts - 1 :: parts]])
    on = jnp.concatenate([jnp.diff(fine.station)[::parts], fine.station[1:2] - fine.station[:1]])
    slope = (after - before) / (to + on)[:, None]
    if params.closed:
        return slope
    ends: Any = ((line[1] - line[0]) / on[0], (line[-1] - line[-2]) / to[-1])
    return slope.at[0].set(ends[0]).at[-1].set(ends[1])


def _nodes(
    road: CrossSections,
    offset: Array,
    lane: np.ndarray,
    vehicle: VehicleParams,
    params: CourseLatticeParams,
    relaxation: Relaxation,
) -> Float[Array, "s m"]:
    """Degree to which each node is there: its lane is, and the footprint lies on the road."""
    right, left = drivable(road)
    half, limits = vehicle.width / 2, params.limits
    over = jnp.maximum(offset + half - left[:, None], right[:, None] + half - offset)
    return road.present[:, lane] * (1 - soft.above(over, limits.tolerance, relaxation, scale=limits.edge_scale))
