"""How far along a route a vehicle is, and what is left of it."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int

from urbanjax.roadmap.graph import RoadGraph
from urbanjax.roadmap.tracing import Route, entry_of
from urbanjax.types import pytree


@pytree
class Remaining:
    """What is driven and what is left of a route; meaningful only where `on_route`."""

    entry: Array  # [] int32, index into the route
    on_route: Array  # [] bool
    driven: Array  # [] m from the start of the route
    distance: Array  # [] m to its end
    time: Array  # [] s to its end at the speed limits


def remaining(
    graph: RoadGraph,
    route: Route,
    *,
    link: int | Int[Array, ""],
    station: float | Float[Array, ""],
    since: int | Int[Array, ""] = 0,
) -> Remaining:
    """Distance and time from `station` [m] on `link` to the end of the route.

    A link that is left by a lane change shares its length with the next one: what is left of it counts in proportion.
    Differentiable in the station.
    Args: graph, the road graph; route, driven now; link and station, where the vehicle is; since, the entry where it
    was last, which tells apart the laps.
    """
    entry, on_route = entry_of(route, link, since=since)
    index = jnp.arange(len(route.link))
    counts = route.valid & ~route.change  # a lane change is made at the start of its link, as in the route's cost
    ahead = counts & (index >= entry)
    share = jnp.clip(station / graph.length[link], 0, 1)
    here = jnp.argmax(ahead)

    def left(part: Array) -> Array:
        return jnp.sum(jnp.where(ahead, part, 0)) - share * part[here]

    length = graph.length[route.link]
    distance = left(length)
    return Remaining(
        entry=entry,
        on_route=on_route,
        driven=jnp.sum(jnp.where(counts, length, 0)) - distance,
        distance=distance,
        time=left(length / graph.speed_limit[route.link]),
    )
