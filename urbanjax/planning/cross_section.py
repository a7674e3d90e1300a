"""The lanes along a plan's stations, as numbers that vary continuously with the station."""

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int

from urbanjax.geometry import frenet
from urbanjax.numerics import lean
from urbanjax.planning.basis import product
from urbanjax.roadmap.corridor import Corridor
from urbanjax.roadmap.progress import Sample, sample
from urbanjax.types import pytree


@pytree
class CrossSections:
    """The road at n stations. Flags are degrees in [0, 1], so that a plan's cost has no jump where a lane begins."""

    station: Array  # [n] m
    position: Array  # [n, 2] m, reference line
    heading: Array  # [n] rad
    curvature: Array  # [n] 1/m
    limit: Array  # [n] m/s
    lane_offset: Array  # [n, Q] m
    lane_width: Array  # [n, Q] m
    present: Array  # [n, Q] degree
    oncoming: Array  # [n, Q] degree
    barred: Array  # [n, Q] lines on the way out from the route's lane to this one that may not be crossed


def cross_sections(window: Corridor, station: Float[Array, "n"]) -> CrossSections:
    """Cross-sections at any stations. Beyond the end of the route its last cross-section holds.

    Args: window, of the route; station [n] m, along it.
    """
    road: Sample = sample(window, station)
    lanes = window.has_lane.shape[-1]
    flags = jnp.concatenate([window.has_lane, window.oncoming, window.change], axis=-1).astype(station.dtype)
    start, within = window.station[0], lean.minimum(station, window.length)
    index, fraction, _ = frenet.cell(start, window.spacing, n=flags.shape[0], station=within)
    degrees = frenet.linear(lean.rows(flags, index), lean.rows(flags, index + 1), fraction=fraction)
    # A line bars every lane beyond it, seen from the route's.
    line, lane = np.arange(lanes - 1)[:, None] + 0.5, np.arange(lanes)[None, :]
    beyond = ((lane < line) & (line < lanes // 2)) | ((lane > line) & (line > lanes // 2))
    return CrossSections(
        station=station,
        position=road.position,
        heading=road.heading,
        curvature=road.curvature,
        limit=road.speed_limit,
        lane_offset=road.lane_offset,
        lane_width=road.lane_width,
        present=degrees[:, :lanes],
        oncoming=degrees[:, lanes : 2 * lanes],
        barred=product(1 - degrees[:, 2 * lanes :], jnp.asarray(beyond, degrees.dtype)),
    )


def covered(offset: Float[Array, "n m"], half_width: float | Array, *, road: CrossSections) -> Float[Array, "n m Q"]:
    """Width [n, M, Q] (m) of each lane that a footprint covers.

    Args: offset [n, M] m, of its middle; half_width m; road, at n stations.
    """
    low, high = (offset - half_width)[..., None], (offset + half_width)[..., None]
    right = (road.lane_offset - road.lane_width / 2)[:, None, :]
    left = (road.lane_offset + road.lane_width / 2)[:, None, :]
    return lean.maximum(lean.minimum(high, left) - lean.maximum(low, right), 0)


def boundaries(road: CrossSections) -> Float[Array, "n e"]:
    """Offset [n, Q - 1] (m) of the line between each lane and the next one to the left. Args: road, at n stations."""
    right = road.lane_offset[:, :-1] + road.lane_width[:, :-1] / 2
    left = road.lane_offset[:, 1:] - road.lane_width[:, 1:] / 2
    return (right + left) / 2


def bars(road: CrossSections, start: Int[np.ndarray, "s"], *, end: Int[np.ndarray, "e"]) -> Float[Array, "n s e"]:
    """Degree to which the way from lane to lane is barred, [n, S, E]: outwards over a line that may not be crossed.

    Back towards the route's lane the way is free. Args: road, at n stations; start [S] and end [E], lanes across.
    """
    middle = road.lane_offset.shape[1] // 2
    same_side = (start[:, None] - middle) * (end[None, :] - middle) >= 0
    passed = road.barred[:, start][:, :, None] * same_side[None].astype(road.barred.dtype)
    return lean.clip(road.barred[:, end][:, None, :] - passed, 0.0, 1.0)


def drivable(road: CrossSections) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
    """Offsets [n] (m) of the right and the left border of the width from the route's lane outwards.

    Args: road, at n stations.
    """
    middle = road.lane_offset.shape[1] // 2

    present = jnp.unstack(road.present, axis=-1)

    def reach(border: Array, outwards: range) -> Array:
        """The border of the lanes from the route's on, each added by the degree to which all up to it are there."""
        borders, reached, open_to = jnp.unstack(border, axis=-1), border[:, middle], 1.0
        for lane in outwards[1:]:
            open_to = open_to * present[lane]
            reached = reached + open_to * (borders[lane] - borders[lane - outwards.step])
        return reached

    half = road.lane_width / 2
    right, left = range(middle, -1, -1), range(middle, len(present))
    return reach(road.lane_offset - half, right), reach(road.lane_offset + half, left)
