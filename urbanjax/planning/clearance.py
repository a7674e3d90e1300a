"""Room between the ego's box along a plan and every predicted box, at the time each point is passed."""

from typing import ClassVar

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.geometry.boxes import Box, relaxed_box_gap
from urbanjax.numerics import lean, safe, soft
from urbanjax.numerics.once import once
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning.basis import product
from urbanjax.planning.prediction import time_weights
from urbanjax.types import SOFT, Prediction, VehicleState, pytree
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.params import VehicleParams


@pytree
class ClearanceParams:
    """How clearance is told."""

    PINNED: ClassVar[dict[str, str]] = {
        "far": "definition: of free",
        "margin": "safety: the gap that is kept before and behind",
        "follower_heading": "safety: of whom the ego need not keep clear",
        "*_scale": SOFT,
    }

    far: float = 100.0  # m, more than this counts as this
    margin: float = 0.0  # m, kept free before and behind the ego
    gap_scale: float = 0.5  # m, difference in gap that counts as clear
    follower_scale: float = 0.5  # m, by which a vehicle must clearly be behind
    follower_heading: float = 0.5  # cosine of the heading difference above which a vehicle goes our way


@pytree
class Passage:
    """Points that the ego passes: n poses of its rear axle, each with the time and the way covered around it."""

    position: Array  # [n, 2] m, rear axle
    heading: Array  # [n] rad
    time: Array  # [n] s
    step: Array | None = None  # [n] m, distance between consecutive points; None: only the points themselves count
    step_time: Array | None = None  # [n] s, time for it


def ego_boxes(passage: Passage, vehicle: VehicleParams, *, origin: Float[Array, "2"]) -> Box:
    """Boxes [n] of the ego at the points of a passage.

    Args: passage; vehicle; origin [2] m, that they are relative to.
    """
    cos, sin = jnp.cos(passage.heading), jnp.sin(passage.heading)
    x, y = jnp.unstack(passage.position - origin[None, :], axis=-1)
    x, y = x + vehicle.centre_offset * cos, y + vehicle.centre_offset * sin
    half_length, half_width = (jnp.asarray(size / 2, cos.dtype) for size in (vehicle.length, vehicle.width))
    return Box(*once(x, y, cos, sin), half_length=half_length, half_width=half_width)


def predicted_boxes(prediction: Prediction, time: Float[Array, "n"], *, origin: Float[Array, "2"]) -> Box:
    """Boxes [n, B] of every object and branch at some times.

    The heading is interpolated as a unit vector, which spares trigonometry for each box. Args: prediction, of everybody
    else; time [n] s from now; origin [2] m, that the boxes are relative to.
    """
    local, heading = prediction.position - origin[None, None, :], prediction.heading
    weights = time_weights(prediction, time)
    values = jnp.stack([*jnp.unstack(local, axis=-1), jnp.cos(heading), jnp.sin(heading)])
    x, y, cos, sin = jnp.unstack(product(weights, jnp.moveaxis(values, -1, 0)), axis=1)
    cos, sin = unit_vector(cos, sin)
    half_length, half_width = prediction.length[None, :] / 2, prediction.width[None, :] / 2
    return Box(x=x, y=y, cos=cos, sin=sin, half_length=half_length, half_width=half_width)


def unit_vector(cos: Float[Array, "*s"], sin: Float[Array, "*s"]) -> tuple[Float[Array, "*s"], Float[Array, "*s"]]:
    """A heading that was interpolated as a vector [*s], made as long as 1 again. Args: cos [*s]; sin [*s]."""
    size = 1 / jnp.sqrt(cos * cos + sin * sin + 1e-12)  # opposite headings may cancel
    return cos * size, sin * size


def gaps(
    passage: Passage, driving: Driving, *, prediction: Prediction, ignored: Float[Array, "b"]
) -> Float[Array, "n b"]:
    """Signed gap [n, B] (m) between the ego at each point and each predicted box when the point is passed.

    The ego is lengthened by the way it covers *relative* to the object between points, so that nothing is skipped: by
    one step against a parked car, not at all behind a leader of equal speed. Args: passage, of the ego; driving, with
    ClearanceParams; prediction, of everybody else; ignored [B], degree to which an object does not count.
    """
    boxes = predicted_boxes(prediction, passage.time, origin=passage.position[0])
    others = Others(boxes, *(x[None, :] for x in (prediction.speed, prediction.valid, ignored)))
    return gaps_between(ego_at(passage, driving), others, mode=driving.relaxation.mode)


@pytree
class Others:
    """C boxes at each of n points, or the same at all."""

    box: Box  # [n, C]
    speed: Array  # [n or 1, C] m/s
    valid: Array  # [n or 1, C] bool
    ignored: Array  # [n or 1, C] degree to which it does not count


@pytree
class Ego:
    """The ego at each of n points, as `gaps_between` needs it."""

    box: Box  # [n, 1], with its margin
    step: Array | None  # [n, 1] m, see `Passage`
    step_time: Array | None  # [n, 1] s
    far: Array  # [] or [n, 1] m, more than this counts as this
    temperature: Array  # [] or [n, 1] m, of gaps


def ego_at(passage: Passage, driving: Driving) -> Ego:
    """The ego at the points of a passage. Args: passage [n]; driving, with ClearanceParams."""
    params = driving.params
    box = jax.tree.map(
        lambda x: x[:, None] if x.ndim else x, ego_boxes(passage, driving.vehicle, origin=passage.position[0])
    )
    step, step_time = (None if x is None else x[:, None] for x in (passage.step, passage.step_time))
    return Ego(
        box=box.replace(half_length=box.half_length + params.margin),
        step=step,
        step_time=step_time,
        far=jnp.asarray(params.far, box.x.dtype),
        temperature=jnp.asarray(driving.relaxation.temperature * params.gap_scale, box.x.dtype),
    )


def gaps_between(ego: Ego, others: Others, *, mode: str) -> Float[Array, "n c"]:
    """Signed gap [n, C] (m) between the ego and some boxes, see `gaps`. Args: ego [n]; others; mode, of relaxation."""
    other, half_length = others.box, ego.box.half_length
    if ego.step is not None and ego.step_time is not None:
        along = ego.box.cos * other.cos + ego.box.sin * other.sin
        swept = ego.step - others.speed * along * ego.step_time
        half_length = half_length + jnp.abs(swept) / 2
    room = relaxed_box_gap(
        ego.box.replace(half_length=half_length),
        other,
        relaxation=Relaxation(mode=mode).replace(temperature=ego.temperature),
    )
    room = room + ego.far * others.ignored
    valid, far = jnp.broadcast_to(others.valid, room.shape), jnp.broadcast_to(ego.far, room.shape)
    return lean.minimum(lean.where(valid, room, far), far)


def followers(state: VehicleState, driving: Driving, *, prediction: Prediction) -> Float[Array, "b"]:
    """Degree to which each object [B] follows the ego: behind it, going its way, bound to reach where it stands now.

    At constant speed every follower would run into an ego that is slower or sets off; keeping that gap is the
    follower's part. A vehicle behind in another lane does not come where the ego stands, and so still counts.
    Args: state, of the ego; driving, with ClearanceParams; prediction, of everybody else.
    """
    params, relaxation = driving.params, driving.relaxation
    n = prediction.time.shape[0]
    here = Passage(
        position=jnp.broadcast_to(state.position, (n, 2)),
        heading=jnp.broadcast_to(state.heading, (n,)),
        time=prediction.time,
        step=jnp.zeros_like(prediction.time),
        step_time=jnp.broadcast_to(prediction.time[1] - prediction.time[0], (n,)),
    )
    nobody = jnp.zeros_like(prediction.speed)
    reaches = safe.minimum(gaps(here, driving, prediction=prediction, ignored=nobody), 0)
    cos, sin = jnp.cos(state.heading), jnp.sin(state.heading)
    x, y = jnp.unstack(prediction.position[:, 0] - state.position[None, :], axis=-1)
    ahead = x * cos + y * sin + prediction.length / 2 + driving.vehicle.rear_overhang
    same_way = jnp.cos(prediction.heading[:, 0] - state.heading)
    behind = soft.above(-ahead, 0.0, relaxation, scale=params.follower_scale)
    hits = soft.above(-reaches, 0.0, relaxation, scale=params.follower_scale)
    goes = soft.above(same_way, params.follower_heading, relaxation, scale=0.5)  # a difference of cosines that is clear
    return behind * hits * goes
