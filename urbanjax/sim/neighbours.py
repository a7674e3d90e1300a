"""Who drives ahead and behind, for all vehicles at once: pairs N x N, no sorting.

Each vehicle looks along a chain of links, the ones it is going to drive. A vehicle stands on up to two links: its own,
and another that its body still covers (the lane it is leaving, or the link behind). Arrays of pairs are [j, i]: the
reduction runs over the first axis, which vectorises.
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int

from urbanjax.numerics import lean, safe
from urbanjax.sim import lanes as roads
from urbanjax.sim.lanes import LaneTables, take
from urbanjax.types import pytree

# m, "nobody there": finite, so that masked arithmetic stays finite. Lengths may have been added to it: what is beyond
# half of it is nobody.
FAR = 1e6
SAME = 1e-3  # m, nearer together than this, vehicles count as at the same place


@pytree
class Chain:
    """The M links that each of N drivers sees ahead, and how far off each begins."""

    link: Array  # [M, N] int32
    start: Array  # [M, N] m from the driver to the start of the link, negative for its own; -FAR where there is none


@pytree
class Bodies:
    """Where N vehicles stand. A vehicle (or its second place) that does not exist stands at -FAR, ahead of nobody."""

    link: Array  # [N] int32
    station: Array  # [N] m, of the box centre
    other: Array  # [N] int32
    other_station: Array  # [N] m
    half: Array  # [N] m, half the length
    speed: Array  # [N] m/s, along the link


@pytree
class Neighbour:
    """The nearest vehicle ahead or behind."""

    gap: Array  # [N] m, bumper to bumper, negative when overlapping; FAR when there is none
    speed: Array  # [N] m/s, 0 when there is none
    index: Array  # [N] int32, which vehicle (meaningless when there is none)
    exists: Array  # [N] bool


def look_ahead(
    lanes: LaneTables,
    link: Int[Array, " n"],
    *,
    station: Float[Array, " n"],
    choice: Int[Array, " n"],
    exists: Bool[Array, " n"],
    n_links: int,
) -> Chain:
    """The chain of links that each driver is going to drive.

    Args: lanes, the simulator's tables; link [N]; station [N] m along it; choice [N], the number of the successor that
    a driver takes, mod their count; exists [N] bool; n_links, M.
    """
    links, starts = [link], [jnp.where(exists, -station, -FAR)]
    for _ in range(n_links - 1):
        follows, goes_on = roads.following(lanes, links[-1], choice=choice)
        starts.append(jnp.where(goes_on, starts[-1] + take(lanes.graph.length, links[-1]), -FAR))
        links.append(follows)
    return Chain(jnp.stack(links), jnp.stack(starts))


def _match(chain_link: Array, chain_start: Array, link: Array, station: Array) -> Array:
    """Distance to (link, station) along the chain, FAR where it is not ahead; all arguments broadcast to [j, i]."""
    distance = station + chain_start
    return jnp.where((chain_link == link) & (distance >= 0), distance, FAR)


def ahead(chain: Chain, bodies: Bodies, *, seen: Bool[Array, "j i"]) -> Float[Array, "j i"]:
    """Distance at which driver i, on its chain, meets the centre of vehicle j; FAR where it does not, or not `seen`.

    Args: chain, of drivers i; bodies, vehicles j; seen [J, I] bool, which pairs count.
    """
    nearest = jnp.asarray(FAR, bodies.station.dtype)
    for link, station in ((bodies.link, bodies.station), (bodies.other, bodies.other_station)):
        for m in range(chain.link.shape[0]):
            found = _match(chain.link[m][None, :], chain.start[m][None, :], link[:, None], station[:, None])
            nearest = lean.minimum(nearest, found)
    return jnp.where(seen, nearest, FAR)


def behind(chain: Chain, link: Array, *, station: Array, seen: Bool[Array, "j i"]) -> Float[Array, "j i"]:
    """Distance at which driver j, on its chain, meets the place (link_i, station_i); FAR where it does not.

    Args: chain, of drivers j; link [I] and station [I] m, the places; seen [J, I] bool, which pairs count.
    """
    nearest = jnp.asarray(FAR, station.dtype)
    for m in range(chain.link.shape[0]):
        found = _match(chain.link[m][:, None], chain.start[m][:, None], link[None, :], station[None, :])
        nearest = lean.minimum(nearest, found)
    return jnp.where(seen, nearest, FAR)


def nearest(distance: Float[Array, "j i"], bodies: Bodies, *, half: Float[Array, " i"]) -> Neighbour:
    """The vehicle j nearest to each i, bumper to bumper. The choice is hard; gap and speed are differentiable.

    Args: distance [J, I] m, between centres, FAR for none; bodies, vehicles j; half [I] m, half the length of each i.
    """
    edge = distance - bodies.half[:, None]
    first = safe.minimum(edge, 0)
    # Not told by equality: the compiler may compute `edge` twice, with different rounding.
    is_first = edge <= first[None, :] + SAME
    exists = first < 0.5 * FAR
    # Among vehicles at the same place the slowest one counts, whatever their order.
    slowest = safe.minimum(jnp.where(is_first, bodies.speed[:, None], FAR), 0)
    last = edge.shape[0] - 1
    index = jnp.min(jnp.where(is_first, jnp.arange(last + 1, dtype=jnp.int32)[:, None], last), axis=0)
    return Neighbour(jnp.where(exists, first - half, FAR), jnp.where(exists, slowest, 0.0), index, exists)
