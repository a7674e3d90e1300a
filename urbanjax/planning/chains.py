"""The links that others are going to drive: where they lead, and who goes first where they meet others."""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int

from urbanjax.numerics import lean
from urbanjax.roadmap import links, priority
from urbanjax.roadmap.graph import RoadGraph, RoadType
from urbanjax.types import Signals, SignalState, pytree

FAR = 1e6  # m, the start of a link that is not there
INSIDE = -1.0  # rank of who is within a junction already
CLOSED = 4.0  # ranks lost by a signal that is not green
BRAKING = 3.5  # m/s^2, with which one still stops at such a signal


@pytree
class LinkChain:
    """The links ahead of each of B = O * branches objects."""

    link: Array  # [B, C] int32, the present link and those after it
    start: Array  # [B, C] m from the start of the present link; a far value where the road has ended
    ways: Array  # [B] int32, number of ways at the first fork, 1 without a fork


@pytree
class OnChains:
    """Places on chains."""

    position: Array  # [B, H, 2] m
    heading: Array  # [B, H] rad
    number: Array  # [B, H] int32, of the link in the chain


def ahead(graph: RoadGraph, link: Int[Array, "b"], *, branch: Int[Array, "b"], hops: int) -> LinkChain:
    """The chain of links ahead.

    Args: graph, the road graph; link [B], the present one; branch [B], the way at the first fork; hops, links followed
    beyond the present one.
    """

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
    (_, _, ways), (found, starts) = jax.lax.scan(hop, (link, graph.length[link], ones), None, length=hops)
    first = jnp.zeros_like(starts[:1])
    return LinkChain(link=jnp.concatenate([link[None], found]).T, start=jnp.concatenate([first, starts]).T, ways=ways)


def along(graph: RoadGraph, chain: LinkChain, *, station: Float[Array, "b h"], offset: Float[Array, "b h"]) -> OnChains:
    """Places at stations from the start of each chain and lateral offsets.

    Args: graph, the road graph; chain [B]; station [B, H] m; offset [B, H] m.
    """
    reached = jnp.sum(station[..., None] >= chain.start[:, None, 1:], axis=-1)
    link = jnp.take_along_axis(chain.link, reached, axis=1)
    local = station - jnp.take_along_axis(chain.start, reached, axis=1)
    at = links.sample(graph, link, station=local)
    left = jnp.stack([-jnp.sin(at.heading), jnp.cos(at.heading)], axis=-1)
    return OnChains(at.position + offset[..., None] * left, at.heading, reached)


def ranks(
    graph: RoadGraph, chain: LinkChain, *, signals: Signals, station: Float[Array, "b"], speed: Float[Array, "b"]
) -> Float[Array, "b c"]:
    """Ranks below priority [B, C] of who comes to each link of its chain; INSIDE on a link within a junction.

    Who has to give way somewhere has to on all that follows. A signal that is not green, and can be stopped at, costs
    CLOSED. Not differentiable. Args: graph, the road graph; chain [B]; signals, what they show; station [B] m, on the
    present link; speed [B] m/s.
    """
    rule, turn = lean.rows(graph.rule, chain.link), lean.rows(graph.turn, chain.link)
    below = priority.rank(rule[:, :-1], turn[:, 1:], like=speed)
    if graph.n_signals:
        shown = signals.shown(graph.signal)
        shut = jnp.any(graph.has_signal & (shown != SignalState.GREEN), axis=1).astype(jnp.int32)
        stops = speed[:, None] ** 2 < 2 * BRAKING * (chain.start[:, 1:] - station[:, None])
        below = below + CLOSED * ((lean.rows(shut, chain.link)[:, :-1] > 0) & stops).astype(below.dtype)
    inside = lean.rows(graph.road_type, chain.link[:, 0]) == RoadType.JUNCTION
    first = jnp.where(inside, INSIDE, 0.0).astype(below.dtype)
    return jax.lax.cummax(jnp.concatenate([first[:, None], below], axis=1), axis=1)
