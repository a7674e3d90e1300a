"""Objects seen from the route: station, offset and speed along it."""

from typing import ClassVar

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import safe, soft
from urbanjax.roadmap.corridor import Corridor
from urbanjax.roadmap.progress import progress, sample
from urbanjax.types import Objects, pytree
from urbanjax.vehicle.driving import Driving


@pytree
class OccupancyParams:
    """When a vehicle counts as being in a lane."""

    PINNED: ClassVar[dict[str, str]] = {
        "*_margin": "safety: the gap that is kept beside others",
        "standing_speed": "definition: of standing",
    }

    lateral_margin: float = 0.3  # m, beside both bodies
    standing_margin: float = 0.15  # m, the same where one who stands is in the way of a path
    anticipation: float = 1.0  # s, for which a vehicle that moves sideways is extrapolated
    standing_speed: float = 0.3  # m/s, below which an object stands


@pytree
class Surroundings:
    """Objects in the route's Frenet frame, with the half extents of their boxes along it."""

    station: Array  # [O] m, box centre
    offset: Array  # [O] m, left positive
    speed: Array  # [O] m/s along the route, negative for oncoming
    lateral_speed: Array  # [O] m/s to the left
    half_length: Array  # [O] m along the route
    half_width: Array  # [O] m across the route
    lane_offset: Array  # [O, Q] m, lane centres at each object's station
    valid: Array  # [O] bool


def relate(objects: Objects, window: Corridor) -> Surroundings:
    """Every object related to the route's reference line; beyond the window or off the road they are invalid.

    Args: objects [O]; window, the lanes around the vehicle.
    """
    place = jax.vmap(lambda position, heading: progress(window, position, heading=heading))
    seen = place(objects.position, objects.heading)
    cos, sin = jnp.cos(seen.heading_error), jnp.sin(seen.heading_error)
    half_length, half_width = objects.length / 2, objects.width / 2
    # Smooth absolute values: a box that turns through the road's direction must not kink the gradient.
    cos_abs, sin_abs = safe.sqrt(cos**2 + 1e-6), safe.sqrt(sin**2 + 1e-6)
    reach = window.lane_width.shape[-1] * 4.0  # m; farther off than all lanes across, an object is not on this road
    inside = (seen.station > window.station[0]) & (seen.station < window.station[-1]) & (jnp.abs(seen.offset) < reach)
    return Surroundings(
        station=seen.station,
        offset=seen.offset,
        speed=objects.speed * cos,
        lateral_speed=objects.speed * sin,
        half_length=half_length * cos_abs + half_width * sin_abs,
        half_width=half_width * cos_abs + half_length * sin_abs,
        lane_offset=sample(window, seen.station).lane_offset,
        valid=objects.valid & inside,
    )


def in_lane(
    surroundings: Surroundings, driving: Driving, *, lane: Float[Array, "o"], margin: Float[Array, "o"] | None = None
) -> Float[Array, "o"]:
    """Degree to which each object occupies a lane, now or after `anticipation` seconds.

    Args: surroundings [O]; driving, with OccupancyParams; lane [O] m, offset of the lane's centre at each object's
    station; margin [O] m, beside both bodies (default: `lateral_margin`).
    """
    params, relaxation = driving.params, driving.relaxation
    kept = params.lateral_margin if margin is None else margin
    reach = surroundings.half_width + driving.vehicle.width / 2 + kept

    def occupied(offset: Array) -> Array:
        beside = safe.sqrt((offset - lane) ** 2 + 1e-6)
        return soft.above(reach - beside, 0.0, relaxation, scale=params.lateral_margin)

    later = surroundings.offset + params.anticipation * surroundings.lateral_speed
    degree = soft.either(occupied(surroundings.offset), occupied(later))
    return jnp.where(surroundings.valid, degree, 0)


def moving(surroundings: Surroundings, driving: Driving) -> Float[Array, "o"]:
    """Degree to which each object moves. Args: surroundings [O]; driving, with OccupancyParams."""
    limit = driving.params.standing_speed
    pace = safe.sqrt(surroundings.speed**2 + surroundings.lateral_speed**2 + 1e-6)
    return soft.above(pace, limit, driving.relaxation, scale=limit)


def in_path(
    surroundings: Surroundings, driving: Driving, *, offset: Float[Array, "o"], moves: Float[Array, "o"]
) -> Float[Array, "o"]:
    """Degree to which each object is in the way of a path; one that stands may be passed closely.

    Args: surroundings [O]; driving, with OccupancyParams; offset [O] m, of the path at each object's rear; moves [O],
    degree to which each moves.
    """
    params = driving.params
    margin = params.standing_margin + moves * (params.lateral_margin - params.standing_margin)
    return in_lane(surroundings, driving, lane=offset, margin=margin)
