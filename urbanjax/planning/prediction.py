"""Where the other road users will be: along the road at constant speed, one branch per way at the first fork."""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import lean, safe
from urbanjax.planning import chains
from urbanjax.planning.basis import hat, product
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.roadmap.locate import Location
from urbanjax.types import POSITIVE, Objects, Prediction, RoadUser, Signals, field, pytree, static

SLOWEST = 1.0  # m/s, for which the times along a way are reckoned at least


@pytree
class PredictionParams:
    """How far and along what objects are predicted."""

    horizon: float = field(default=8.0, metadata=POSITIVE)  # s
    settle_time: float = 1.0  # s, time constant with which an object turns parallel to its lane
    heading_gate: float = 0.8  # rad, off the lane's direction by more, an object is taken to drive straight on
    heading_ramp: float = 0.3  # rad, over which the two blend
    shortest_way: float = 24.0  # m, that is followed for conflicts; more where more is driven within the horizon
    longest_way: float = 110.0  # m
    n_times: int = static(default=17)
    n_way: int = static(default=32)  # points of that way
    branches: int = static(default=2)  # ways followed at the first fork
    hops: int = static(default=6)  # links followed beyond the present one


@pytree
class Ways:
    """Where B objects and branches are going to drive, however fast: M points along the way of each."""

    position: Array  # [B, M, 2] m, box centre
    distance: Array  # [B, M] m from where they are
    rank: Array  # [B, M] ranks below priority of who comes there, see `chains.ranks`
    speed: Array  # [B] m/s
    length: Array  # [B] m
    width: Array  # [B] m
    on_foot: Array  # [B] 0 or 1
    valid: Array  # [B] bool


def predict(
    graph: RoadGraph, objects: Objects, *, locations: Location, signals: Signals, params: PredictionParams
) -> tuple[Prediction, Ways]:
    """Boxes of every object at H times, following its lane at constant speed and keeping its lateral offset; its way.

    Branch b takes the b-th way at the first fork and the first way at later ones; where there is no b-th way the branch
    is invalid. A heading error dies out with `settle_time`, so that a vehicle on its way to the next lane is
    predicted sideways. An object that is not on a lane, or far off its direction, keeps a straight line, and so does
    one beyond the end of the road. Args: graph, the road graph; objects [O], everybody else; locations [O], of the
    objects on the graph; signals, what they show.
    """
    objects, locations = (
        jax.tree.map(lambda x: jnp.repeat(x, params.branches, axis=0), t) for t in (objects.with_kinds(), locations)
    )
    dtype = objects.position.dtype
    time = params.horizon * jnp.linspace(0, 1, params.n_times, dtype=dtype)
    branch = jnp.arange(objects.speed.shape[0]) % params.branches
    chain = chains.ahead(graph, locations.link, branch=branch, hops=params.hops)
    reach = jnp.clip(objects.speed * params.horizon, params.shortest_way, params.longest_way)
    distance = reach[:, None] * jnp.linspace(0, 1, params.n_way, dtype=dtype)[None, :]
    travelled = jnp.concatenate([objects.speed[:, None] * time[None, :], distance], axis=1)
    pace = lean.maximum(objects.speed, SLOWEST)[:, None]
    at = jnp.concatenate([jnp.broadcast_to(time, (len(branch), len(time))), distance / pace], axis=1)

    settle = 1 - jnp.exp(-at / params.settle_time)
    error = locations.heading_error[:, None]
    offset = locations.offset[:, None] + objects.speed[:, None] * jnp.sin(error) * params.settle_time * settle
    along = chains.along(graph, chain, station=locations.station[:, None] + travelled, offset=offset)
    # A projected point and its reconstruction differ by a hair on bent polylines: start exactly at the object.
    position = along.position + (objects.position - along.position[:, 0])[:, None]
    heading = (along.heading + error * (1 - settle))[:, : len(time)]

    direction = jnp.stack([jnp.cos(objects.heading), jnp.sin(objects.heading)], axis=-1)
    straight = objects.position[:, None, :] + travelled[..., None] * direction[:, None, :]
    turned = jnp.diff(heading, axis=1, prepend=objects.heading[:, None])
    turned = lean.running_sum(safe.wrap_angle(turned))[:, 1:]
    beyond = (params.heading_gate + params.heading_ramp - jnp.abs(locations.heading_error)) / params.heading_ramp
    follows = jnp.clip(beyond, 0, 1) * locations.valid.astype(dtype)
    position = straight + follows[:, None, None] * (position - straight)
    valid = objects.valid & ((branch == 0) | ((branch < chain.ways) & (follows > 0)))
    future = Prediction(
        position=position[:, : len(time)],
        heading=objects.heading[:, None] + follows[:, None] * turned,
        speed=objects.speed,
        length=objects.length,
        width=objects.width,
        time=time,
        valid=valid,
    )
    rank = chains.ranks(graph, chain, signals=signals, station=locations.station, speed=objects.speed)
    reached = along.number[:, len(time) :]
    return future, Ways(
        position=position[:, len(time) :],
        distance=distance,
        rank=follows[:, None] * jnp.take_along_axis(rank, reached, axis=1),
        speed=objects.speed,
        length=objects.length,
        width=objects.width,
        on_foot=(objects.kind == RoadUser.PEDESTRIAN).astype(dtype),
        valid=valid,
    )


def boxes_at(prediction: Prediction, time: Float[Array, "n"]) -> tuple[Float[Array, "b n 2"], Float[Array, "b n"]]:
    """Box centres [B, n, 2] (m) and headings [B, n] (rad) at any times [n] (s), linear between the predicted times.

    Past the horizon objects keep their last velocity. Args: prediction, of everybody else; time [n] s from now.
    """
    values = jnp.concatenate([prediction.position, prediction.heading[..., None]], axis=-1)
    sampled = product(time_weights(prediction, time), jnp.moveaxis(values, 0, 1))
    sampled = jnp.moveaxis(sampled, 1, 0)
    return sampled[..., :2], sampled[..., 2]


def time_weights(prediction: Prediction, time: Float[Array, "n"]) -> Float[Array, "n h"]:
    """Weights [n, H] over the predicted times that interpolate at any other.

    Args: prediction, of everybody else; time [n] s from now.
    """
    spacing = prediction.time[1] - prediction.time[0]
    return hat(time, prediction.time[0], spacing, prediction.time.shape[0], extrapolate=True)
