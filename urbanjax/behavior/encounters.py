"""Where and when the ways of others meet the route's lane ahead: who comes into it, when, and who goes first."""

from typing import ClassVar

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.behavior.situation import Body
from urbanjax.numerics import lean, safe, soft
from urbanjax.planning.prediction import Ways
from urbanjax.planning.situation import Situation
from urbanjax.roadmap.corridor import Corridor
from urbanjax.types import SOFT, pytree
from urbanjax.vehicle.driving import Driving

BEHIND = 8.0  # m behind the rear bumper, from where on the route's lane is looked at
EVERY = 4  # stations of the window between places at which it is
PLACES = 24  # of these
FAR = 1e3  # m or s: never


@pytree
class EncounterParams:
    """When the way of another meets the ego's."""

    PINNED: ClassVar[dict[str, str]] = {
        "margin": "safety: the gap that is kept beside others",
        "follower_heading": "safety: who goes the ego's way and is left to car following",
        "*_scale": SOFT,
    }

    margin: float = 0.4  # m, beside both bodies
    follower_heading: float = 0.5  # cosine of the heading difference above which one in the lane goes the ego's way
    lateral_scale: float = 0.3  # m, by which a body is clearly in the lane
    heading_scale: float = 0.3  # difference of cosines that is clear


@pytree
class Encounters:
    """How the ways of B objects and branches meet the route's lane; stations along the route."""

    enters: Array  # [B] m, station where the stretch begins that both use
    leaves: Array  # [B] m, station where it ends; a far one where the other stays in the lane
    way_in: Array  # [B] m that the other one's front has to go until then, 0 when it is there
    way_out: Array  # [B] m until its rear has left it, or has left the place where a merging one came in
    merges: Array  # [B] degree to which it stays in the lane
    rank: Array  # [B] ranks below priority, of the other one
    meets: Array  # [B] degree to which there is such a stretch ahead


def encounters(situation: Situation, driving: Driving, *, body: Body) -> Encounters:
    """How the ways of all others meet the route's lane ahead.

    One who is in the lane already and goes the ego's way is no encounter: it leads or follows. First and last points of
    a way in the lane are expectations, which in mode hard are the points themselves, linear between points. Args:
    situation, of the step; driving, with EncounterParams; body, of the ego.
    """
    params, relaxation, ways = driving.params, driving.relaxation, situation.ways
    assert ways is not None
    station, offset, along = beside_route(situation.window, ways, body=body)
    reach = (driving.vehicle.width + ways.width)[:, None] / 2 + params.margin
    away = safe.sqrt(offset**2 + 1e-6)
    across = soft.above(reach - away, 0.0, relaxation, scale=params.lateral_scale)
    seen = EVERY * (PLACES - 3) * situation.window.spacing
    near = (station < body.rear + seen).astype(across.dtype)
    within = across * near * soft.above(station, body.rear, relaxation, scale=1.0)
    going = soft.above(along[:, 0], params.follower_heading, relaxation, scale=params.heading_scale)
    counts = soft.negate(across[:, 0] * going) * ways.valid.astype(within.dtype)

    step = ways.distance[:, 1:2] - ways.distance[:, :1]
    first, last = within * before(within), within * before(within[:, ::-1])[:, ::-1]
    any_of = 1 - jnp.prod(1 - within, axis=1)
    # Where between two points the edge of the lane is crossed.
    share = lean.clip(safe.divide((reach - away)[:, 1:], away[:, :-1] - away[:, 1:], otherwise=0.0), 0.0, 1.0)
    back = safe.divide((reach - away)[:, :-1], away[:, 1:] - away[:, :-1], otherwise=0.0)
    edge_in = ways.distance - step * jnp.pad(share, ((0, 0), (1, 0)))
    edge_out = ways.distance + step * jnp.pad(lean.clip(back, 0.0, 1.0), ((0, 0), (0, 1)))

    def at(weights: Array, values: Array) -> Array:
        return safe.divide(jnp.sum(weights * values, axis=1), any_of, otherwise=0.0)

    # One who is in the lane where it comes out of sight stays there.
    latest = near * before(near[:, ::-1])[:, ::-1]
    stays = jnp.sum(latest * across, axis=1)
    merges = soft.both(stays, soft.above(at(last, along), 0.0, relaxation, scale=params.heading_scale))
    half, side = ways.length / 2, ways.width / 2
    enters = soft.minimum(station + (1 - within) * FAR, relaxation, scale=1.0) - side
    leaves = -soft.minimum(-station + (1 - within) * FAR, relaxation, scale=1.0) + side
    entry, end = at(first, edge_in), at(last, edge_out)
    return Encounters(
        enters=enters,
        leaves=leaves + merges * FAR,
        way_in=lean.maximum(entry - half, 0.0),
        way_out=merges * entry + (1 - merges) * end + half,
        merges=merges,
        rank=at(first, ways.rank),
        meets=any_of * counts,
    )


def before(degree: Float[Array, "b m"]) -> Float[Array, "b m"]:
    """Degree to which none of those before is so. Args: degree [B, M]."""
    none = jnp.cumprod(1 - degree, axis=1)
    return jnp.concatenate([jnp.ones_like(none[:, :1]), none[:, :-1]], axis=1)


def beside_route(window: Corridor, ways: Ways, *, body: Body) -> tuple[Array, Array, Array]:
    """Station m, lateral offset m from the route's lane, and cosine of the heading relative to it, [B, M] each.

    From the nearest of a few places along it; a point beyond them is far off to the side. Args: window, the lanes
    around the vehicle; ways [B]; body, of the ego.
    """
    first = (body.rear - BEHIND - window.station[0]) / window.spacing
    count = window.station.shape[0]
    first = jnp.clip(jnp.floor(first), 0, max(count - EVERY * PLACES, 0)).astype(jnp.int32)
    rows = jnp.minimum(first + EVERY * jnp.arange(PLACES, dtype=jnp.int32), count - 1)
    x, y, heading = (lean.rows(v, rows) for v in (window.position[:, 0], window.position[:, 1], window.heading))
    px, py = ways.position[..., 0], ways.position[..., 1]
    miss = (px[..., None] - x[None, None, :]) ** 2 + (py[..., None] - y[None, None, :]) ** 2
    index = lean.argmin(miss)
    table = jnp.stack([x, y, jnp.cos(heading), jnp.sin(heading), lean.rows(window.station, rows)], axis=-1)
    x, y, cos, sin, station = jnp.unstack(lean.rows(table, index), axis=-1)
    dx, dy = px - x, py - y
    along, aside = cos * dx + sin * dy, cos * dy - sin * dx
    beyond = lean.maximum(jnp.abs(along) - EVERY * window.spacing, 0.0)
    ahead = jnp.diff(ways.position, axis=1)
    ahead = jnp.concatenate([ahead, ahead[:, -1:]], axis=1)
    length = safe.norm(ahead)
    same = safe.divide(ahead[..., 0] * cos + ahead[..., 1] * sin, length, otherwise=1.0)
    return station + along, aside + jnp.where(aside < 0, -beyond, beyond), same
