"""Where the other road users will be: along the road at constant speed, one branch per way at the first fork."""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import lean, safe
from urbanjax.planning.basis import hat, product
from urbanjax.roadmap import links
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.roadmap.locate import Location
from urbanjax.types import POSITIVE, Objects, Prediction, field, pytree, static


@pytree
class PredictionParams:
    """How far and along what objects are predicted."""

    horizon: float = field(default=8.0, metadata=POSITIVE)  # s
    settle_time: float = 1.0  # s, time constant with which an object turns parallel to its lane
    heading_gate: float = 0.8  # rad, off the lane's direction by more, an object is taken to drive straight on
    heading_ramp: float = 0.3  # rad, over which the two blend
    n_times: int = static(default=17)
    branches: int = static(default=2)  # ways followed at the first fork
    hops: int = static(default=6)  # links followed beyond the present one


@pytree
class LinkChain:
    """The links ahead of each of B = O * branches objects."""

    link: Array  # [B, C] int32, the present link and those after it
    start: Array  # [B, C] m from the start of the present link; a far value where the road has ended
    ways: Array  # [B] int32, number of ways at the first fork, 1 without a fork


FAR = 1e6  # m, the start of a link that is not there


def predict(graph: RoadGraph, objects: Objects, *, locations: Location, params: PredictionParams) -> Prediction:
    """Boxes of every object at H times, following its lane at constant speed and keeping its lateral offset.

    Branch b takes the b-th way at the first fork and the first way at later ones; where there is no b-th way the branch
    is invalid. A heading error dies out with `settle_time`, so that a vehicle on its way to the next lane is
    predicted sideways. An object that is not on a lane, or far off its direction, keeps a straight line, and so does
    one beyond the end of the road. Args: graph, the road graph; objects [O], everybody else; locations [O], of the
    objects on the graph.
    """
    objects, locations = (
        jax.tree.map(lambda x: jnp.repeat(x, params.branches, axis=0), t) for t in (objects, locations)
    )
    dtype = objects.position.dtype
    time = params.horizon * jnp.linspace(0, 1, params.n_times, dtype=dtype)
    branch = jnp.arange(objects.speed.shape[0]) % params.branches
    chain = _follow(graph, locations.link, branch, params.hops)

    settle = 1 - jnp.exp(-time / params.settle_time)
    error = locations.heading_error[:, None]
    offset = locations.offset[:, None] + objects.speed[:, None] * jnp.sin(error) * params.settle_time * settle[None, :]
    station = locations.station[:, None] + objects.speed[:, None] * time[None, :]
    position, heading = _along(graph, chain, station, offset)
    # A projected point and its reconstruction differ by a hair on bent polylines: start exactly at the object.
    position = position + (objects.position - position[:, 0])[:, None]
    heading = heading + error * (1 - settle)[None, :]

    direction = jnp.stack([jnp.cos(objects.heading), jnp.sin(objects.heading)], axis=-1)
    travelled = (objects.speed[:, None] * time[None, :])[..., None] * direction[:, None, :]
    straight = objects.position[:, None, :] + travelled
    turned = jnp.diff(heading, axis=1, prepend=objects.heading[:, None])
    turned = lean.running_sum(safe.wrap_angle(turned))[:, 1:]
    beyond = (params.heading_gate + params.heading_ramp - jnp.abs(locations.heading_error)) / params.heading_ramp
    follows = jnp.clip(beyond, 0, 1) * locations.valid.astype(dtype)
    return Prediction(
        position=straight + follows[:, None, None] * (position - straight),
        heading=objects.heading[:, None] + follows[:, None] * turned,
        speed=objects.speed,
        length=objects.length,
        width=objects.width,
        time=time,
        valid=objects.valid & ((branch == 0) | ((branch < chain.ways) & (follows > 0))),
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


def _follow(graph: RoadGraph, link: Array, branch: Array, hops: int) -> LinkChain:
    """The chain of links ahead. Args: link [B] int, the present one; branch [B] int, the way at the first fork."""

    def hop(carry: tuple[Array, ...], _: None) -> tuple[tuple[Array, ...], tuple[Array, Array]]:
        here, end, ways = carry
        has = graph.has_successor[here]
        count = jnp.sum(has, axis=1, dtype=here.dtype)
        fork = (count > 1) & (ways == 1)
        way = jnp.where(fork, jnp.minimum(branch, count - 1), 0)
        picked = has & (jnp.cumsum(has, axis=1) - 1 == way[:, None])
        following = jnp.sum(jnp.where(picked, graph.successor[here], 0), axis=1)
        following = jnp.where(count > 0, following, here).astype(here.dtype)
        start = jnp.where(count > 0, end, FAR)
        end = jnp.minimum(start + graph.length[following], FAR)
        return (following, end, jnp.where(fork, count, ways)), (following, start)

    ones = jnp.ones_like(link)
    (_, _, ways), (ahead, starts) = jax.lax.scan(hop, (link, graph.length[link], ones), None, length=hops)
    first = jnp.zeros_like(starts[:1])
    return LinkChain(link=jnp.concatenate([link[None], ahead]).T, start=jnp.concatenate([first, starts]).T, ways=ways)


def _along(
    graph: RoadGraph, chain: LinkChain, station: Float[Array, "b h"], offset: Float[Array, "b h"]
) -> tuple[Float[Array, "b h 2"], Float[Array, "b h"]]:
    """Position [B, H, 2] (m) and heading [B, H] (rad) at stations from the start of each chain and lateral offsets."""
    reached = jnp.sum(station[..., None] >= chain.start[:, None, 1:], axis=-1)
    link = jnp.take_along_axis(chain.link, reached, axis=1)
    local = station - jnp.take_along_axis(chain.start, reached, axis=1)
    at = links.sample(graph, link, station=local)
    left = jnp.stack([-jnp.sin(at.heading), jnp.cos(at.heading)], axis=-1)
    return at.position + offset[..., None] * left, at.heading
