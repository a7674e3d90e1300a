"""Places whose station is roughly known: where they are along a corridor, and which of its lanes they lie in."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.geometry import frenet
from urbanjax.roadmap.corridor import Corridor
from urbanjax.roadmap.progress import sample
from urbanjax.types import pytree

SEAM = 0.05  # m, a gap between lanes up to which the road goes on


@pytree
class LanesThere:
    """The lanes across that places lie in."""

    inside: Array  # [*n, Q] bool, within the borders of a lane that there is
    oncoming: Array  # [*n, Q] bool, and its direction is against the route


def nearby(corridor: Corridor, position: Float[Array, "*n 2"], *, station: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Stations [*n] m of places, by two steps of Newton's method from the stations that they were thought to have.

    Exact to a millimetre from a few metres off on bends that a car drives; `progress` needs no guess and looks along
    the whole corridor. Args: corridor, the whole or a window of it; position [*n, 2] m; station [*n] m, the guess.
    """
    line = frenet.tabulated(corridor.position, corridor.heading, start=corridor.station[0], spacing=corridor.spacing)

    def improve(station: Array) -> Array:
        place = frenet.locate(line, station)
        at = frenet.read(place)
        x, y = position[..., 0] - at.x, position[..., 1] - at.y
        return station + (at.cos * x + at.sin * y) / frenet.scale(place.bend, at.cos * y - at.sin * x)

    return improve(improve(station))


def lanes_at(corridor: Corridor, position: Float[Array, "*n 2"], *, station: Float[Array, "*n"]) -> LanesThere:
    """The lanes across that places lie in; none off the road.

    Args: corridor, the whole or a window of it; position [*n, 2] m; station [*n] m, where they are along it.
    """
    at = sample(corridor, station)
    x, y = jnp.unstack(position - at.position, axis=-1)
    aside = jnp.cos(at.heading) * y - jnp.sin(at.heading) * x
    inside = at.has_lane & (jnp.abs(aside[..., None] - at.lane_offset) <= (at.lane_width + SEAM) / 2)
    return LanesThere(inside, inside & at.oncoming)


def thinned(corridor: Corridor, every: int) -> Corridor:
    """Every so many stations of a corridor: a shorter table to look for places in, cubic between its rows as before.

    Args: corridor, the whole or a window of it; every, of how many stations the first is kept.
    """
    along = ("station", "position", "heading", "curvature", "lane_offset", "lane_width", "lane_link", "has_lane")
    rules = ("oncoming", "change", "speed_limit", "turn", "rank", "line", "valid")
    kept = {name: getattr(corridor, name)[::every] for name in (*along, *rules)}
    return corridor.replace(**kept, spacing=corridor.spacing * every)
