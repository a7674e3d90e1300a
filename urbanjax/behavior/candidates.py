"""Connecting paths: from the present pose onto a lane, and how clear they are at free-flow speed."""

from typing import ClassVar

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.geometry import frenet
from urbanjax.numerics import polynomial, safe, soft
from urbanjax.numerics.once import once
from urbanjax.planning.clearance import Passage
from urbanjax.planning.nearest import nearest
from urbanjax.planning.situation import Situation
from urbanjax.roadmap.progress import Sample
from urbanjax.types import SOFT, Path, Prediction, pytree
from urbanjax.vehicle.driving import Driving


@pytree
class ConnectParams:
    """How a path joins a lane."""

    PINNED: ClassVar[dict[str, str]] = {"terminal_scale": SOFT}

    duration: float = 3.0  # s, to reach the lane's centre
    min_length: float = 8.0  # m
    terminal_scale: float = 1.0  # m, by which the terminal point clearly lies farther to the side than others


def connect(
    situation: Situation, params: ConnectParams, *, road: Sample, station: Float[Array, "k"], lane: Float[Array, "k"]
) -> Path:
    """The path from the present pose that joins a lane by a quintic in station and then follows it.

    Args: situation, of the step; road [K], on the shared grid; station [K] m, the grid, from the vehicle on; lane [K]
    m, offset of the lane's centre on it.
    """
    start = situation.progress
    length = jnp.maximum(params.duration * situation.ego.speed, params.min_length)
    lane_slope = jnp.asarray(jnp.gradient(lane, station[1] - station[0]))
    slope = jnp.tan(jnp.clip(start.heading_error, -1.0, 1.0)) - lane_slope[0]
    zero, away = jnp.zeros_like(slope), start.offset - lane[0]
    # The path is planned anew at each step, so only its first metres are driven: the bend of the cubic that joins the
    # lane makes them a damped return (ratio 0.8), where a bend of zero would make them drift past the lane.
    bend = -(6 * away / length + 4 * slope) / length
    blend = polynomial.quintic((away, slope, bend), (zero, zero, zero), duration=length)
    deviation, first, second = polynomial.evaluate(blend, jnp.clip(station - station[0], 0, length))
    offset, slope, bend = once(lane + deviation, lane_slope + first, second)
    heading, curvature = frenet.offset_curve(road.heading, road.curvature, offset=offset, slope=slope, bend=bend)
    position = frenet.to_world(frenet.Reference(road.position, road.heading, road.curvature), offset)
    return Path(station=station, offset=offset, position=position, heading=heading, curvature=curvature)


def room_along(
    path: Path,
    driving: Driving,
    *,
    time: Float[Array, "k"],
    horizon: float | Array,
    prediction: Prediction,
    follower: Float[Array, "b"],
) -> Float[Array, ""]:
    """Smallest gap [] m to any predicted box over a path, within a time.

    Args: path [K]; driving, with ClearanceParams; time [K] s, of passing each point; horizon s; prediction, of
    everybody else; follower [B], degree to which an object does not count.
    """
    params, relaxation = driving.params, driving.relaxation
    step = safe.norm(jnp.diff(path.position, axis=0, prepend=path.position[:1]))
    passage = Passage(
        position=path.position, heading=path.heading, time=time, step=step, step_time=jnp.diff(time, prepend=time[:1])
    )
    room = nearest(passage, driving, prediction=prediction, ignored=follower)
    # Clearance beyond the horizon counts less and less within its last second, so that no object enters with a jump.
    counts = jnp.clip(horizon - time, 0.0, 1.0)
    return soft.minimum(room + (1 - counts) * params.far, relaxation, scale=params.gap_scale)
