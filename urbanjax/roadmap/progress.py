"""Where poses are along a corridor, what the corridor is there, and where places beside it are in the plane."""

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Float

from urbanjax.geometry import frenet
from urbanjax.numerics import lean, safe
from urbanjax.roadmap.corridor import Corridor
from urbanjax.types import pytree

AGAINST = 25.0  # m^2, by which a station that crosses the pose at a right angle counts as farther off
REACH = 3  # stations
SEARCH_STEPS = 3  # of Newton's method, before the two that are differentiated
LATER = 1e-4  # m^2 per m of station, likewise: of several laps the first one counts


@pytree
class Sample:
    """The corridor at some stations."""

    position: Array  # [*n, 2] m, reference line
    heading: Array  # [*n] rad
    curvature: Array  # [*n] 1/m
    lane_offset: Array  # [*n, Q] m
    lane_width: Array  # [*n, Q] m
    has_lane: Array  # [*n, Q] bool
    oncoming: Array  # [*n, Q] bool
    speed_limit: Array  # [*n] m/s


@pytree
class Progress:
    """Where a pose is along the reference line."""

    station: Array  # [] m from the start of the route
    offset: Array  # [] m, left positive
    heading_error: Array  # [] rad in [-pi, pi), of the pose against the reference line


def sample(corridor: Corridor, station: Float[Array, "*n"]) -> Sample:
    """The corridor at any stations [m].

    Position, heading, curvature, offsets, widths and speed limit are continuous in the station; flags are those of the
    nearest row. Beyond the table the reference line goes straight on and the lanes beside it.
    Args: corridor, the whole or a window of it; station [*n] m.
    """
    flags = jnp.concatenate([corridor.has_lane, corridor.oncoming], axis=-1).astype(station.dtype)
    columns = (corridor.lane_offset, corridor.lane_width, corridor.curvature, corridor.speed_limit, flags)
    place = frenet.locate(_line(corridor, *columns), station)
    at, lanes = frenet.read(place), corridor.lane_offset.shape[-1]
    lane_offset, lane_width, curvature, limit, _ = jnp.split(
        at.others, (lanes, 2 * lanes, 2 * lanes + 1, 2 * lanes + 2), axis=-1
    )
    has_lane, oncoming = jnp.split(place.nearest[..., -2 * lanes :] > 0.5, 2, axis=-1)
    return Sample(
        position=at.position,
        heading=at.heading,
        curvature=curvature[..., 0],
        lane_offset=lane_offset,
        lane_width=lane_width,
        has_lane=has_lane,
        oncoming=oncoming,
        speed_limit=limit[..., 0],
    )


def to_world(
    corridor: Corridor, station: Float[Array, "*n"], *, offset: Float[Array, "*n"]
) -> tuple[Float[Array, "*n 2"], Float[Array, "*n"], Float[Array, "*n"]]:
    """Positions [m], headings of the reference line [rad] and curvatures of the parallel curve [1/m].

    Args: corridor, the whole or a window of it; station [*n] m; offset d [*n] m, left positive, constant along the
    curve, whose curvature is kappa / (1 - kappa d).
    """
    at = frenet.sample(
        corridor.position,
        corridor.heading,
        curvature=corridor.curvature,
        start=corridor.station[0],
        spacing=corridor.spacing,
        station=station,
    )
    return frenet.to_world(at, offset), at.heading, at.curvature / frenet.scale(at.curvature, offset)


def progress(corridor: Corridor, position: Float[Array, "2"], *, heading: Float[Array, ""]) -> Progress:
    """Station [m], offset [m] and heading error [rad] of a pose on the reference line; the inverse of `to_world`.

    The foot of the perpendicular, by Newton's method from the nearest station; stations that run against the pose's
    heading count as farther off, so that a road which comes back beside itself is not mistaken, and of several laps the
    first one is taken. Continuous and differentiable in the pose up to the centre of curvature; the choice of the
    starting station is not differentiated.
    Args: corridor, the whole or a window of it; position [2] m; heading [] rad.
    """
    line, last = _line(corridor), corridor.station.shape[0] - 1
    x, y = position
    miss = (x - corridor.position[:, 0]) ** 2 + (y - corridor.position[:, 1]) ** 2
    miss = miss + LATER * (corridor.station - corridor.station[0])
    k = lean.argmin(miss + AGAINST * (1 - jnp.cos(heading - corridor.heading)))
    reach = REACH * corridor.spacing  # off a bend's inner side Newton's method may not run away along the road
    station = corridor.station[k]
    low = jnp.where(k == 0, -jnp.inf, station - reach)
    high = jnp.where(k == last, jnp.inf, station + reach)

    # A loop, and not so many repeats of its equations; the last round reads off the result.
    def improve(iteration: Array, now: tuple[Array, Progress]) -> tuple[Array, Progress]:
        station, _ = now
        # Two steps of Newton's method carry the exact derivative.
        station = jnp.where(iteration < SEARCH_STEPS, lax.stop_gradient(station), station)
        place = frenet.locate(line, station)
        at = frenet.read(place)
        along, aside = at.cos * (x - at.x) + at.sin * (y - at.y), at.cos * (y - at.y) - at.sin * (x - at.x)
        following = station + along / frenet.scale(place.bend, aside)
        return lean.clip(following, low, high), Progress(station, aside, at.heading)

    _, found = lax.fori_loop(0, SEARCH_STEPS + 3, improve, (station, Progress(station, station, station)))
    return found.replace(heading_error=safe.wrap_angle(heading - found.heading_error))


def _line(corridor: Corridor, *others: Array) -> frenet.Line:
    """The reference line as a table, with what else is to be read along it."""
    start = corridor.station[0]
    return frenet.tabulated(corridor.position, corridor.heading, *others, start=start, spacing=corridor.spacing)
