"""A route traced link by link: from a start, on the best ways to one target after the other (Eq. 12)."""

import jax
import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Int

from urbanjax.roadmap.graph import RoadGraph
from urbanjax.roadmap.moves import Moves, RouteParams, moves
from urbanjax.roadmap.potential import Potential, potential
from urbanjax.types import Status, pytree, static


@pytree
class Route:
    """Links in driving order, padded to R."""

    link: Array  # [R] int32
    valid: Array  # [R] bool
    change: Array  # [R] bool, the next link is entered by a lane change, not at the end of this one
    leg: Array  # [R] int32, how many targets (via-points and goals, of all laps) are reached with this link
    cost: Array  # [] m or s, with the penalties (in `lexicographic` without)
    status: Array  # [] int32, a Status


@pytree
class Trip:
    """What a route is for: the links `via` in order and then the goal; this circuit is driven `laps` times."""

    goal: int | Array  # [] int32, a link
    via: tuple[int | Array, ...] = ()  # links
    blocked: Array | None = None  # [L] bool, links that cannot be driven
    laps: int = static(default=1)


@pytree
class Itinerary:
    """The targets to be visited in order, so many times over, and the best ways to each (V variants)."""

    moves: Moves
    targets: Array  # [T] int32
    tables: Potential  # [V, T, ...]
    n_legs: Array  # [] int32, T times the laps


def entry_of(route: Route, link: int | Int[Array, ""], *, since: int | Int[Array, ""] = 0) -> tuple[Array, Array]:
    """The first entry [] of the route at or after `since` that is this link; and whether there is one, else `since`.

    Args: route, in driving order; link, sought; since, entry from which the search starts.
    """
    here = (route.link == link) & route.valid & (jnp.arange(len(route.link)) >= since)
    on_route = jnp.any(here)
    return jnp.where(on_route, jnp.argmax(here), since).astype(jnp.int32), on_route


def itinerary_to(graph: RoadGraph, trip: Trip, *, params: RouteParams) -> Itinerary:
    """The targets of a trip, with the table of each for each variant of the search.

    Args: graph, the road graph; trip, what the route is for.
    """
    targets = jnp.stack([jnp.asarray(link, jnp.int32) for link in (*trip.via, trip.goal)])
    ways = moves(graph, params, blocked=trip.blocked)
    variants = (
        [ways] if params.search != "two_stage" else [moves(graph, params, changes=False, blocked=trip.blocked), ways]
    )
    tables = [lax.map(lambda target, m=m: potential(m, target), targets) for m in variants]
    stacked = jax.tree.map(lambda *x: jnp.stack(x), *tables)
    return Itinerary(ways, targets, stacked, jnp.asarray(trip.laps * len(targets), jnp.int32))


def trace(itinerary: Itinerary, link: Array, *, leg: Array, moved: Array, n_links: int) -> Route:
    """The route from `link` through the targets from number `leg` on.

    Args: itinerary, the targets and the ways to them; link, where the route starts; leg, number of the first target;
    moved, whether starting at that target is reaching it; n_links, R.
    """
    ways, tables, targets = itinerary.moves, itinerary.tables, itinerary.targets
    n_targets = len(targets)

    def choose(link: Array, leg: Array) -> tuple[Array, Array]:
        """The first variant by which the leg can be driven from here, and whether there is one."""
        target = leg % n_targets
        reach = jnp.where(link == targets[target], tables.circuit[:, target], tables.cost[:, target, link])
        return jnp.argmax(jnp.isfinite(reach)), jnp.any(jnp.isfinite(reach))

    def step(carry: tuple[Array, ...], _: None) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        link, leg, moved, variant, cost, driving, reachable = carry
        arrived = (link == targets[leg % n_targets]) & moved
        leg = leg + arrived.astype(leg.dtype)
        done = leg == itinerary.n_legs
        fresh, possible = choose(link, leg)
        variant = jnp.where(arrived, fresh, variant)
        possible = jnp.where(arrived, possible, reachable)
        move = tables.move[variant, leg % n_targets, link]
        going = driving & ~done & possible
        spent = jnp.where(going, ways.cost[link, move], jnp.where(driving & done, ways.drive[link], 0))
        out = link, driving, going & (move >= ways.link.shape[1] - 2), leg
        carry = (
            jnp.where(going, ways.link[link, move], link),
            leg,
            jnp.asarray(True),
            variant,
            cost + spent,
            going,
            jnp.where(driving & ~done, possible, reachable),
        )
        return carry, out

    variant, possible = choose(link, leg)
    possible = possible | ((link == targets[leg % n_targets]) & moved) | (leg == itinerary.n_legs)
    first = (link, leg, moved, variant, jnp.zeros_like(ways.drive[0]), jnp.asarray(True), possible)
    (_, _, _, _, cost, driving, reachable), (links, valid, change, legs) = lax.scan(step, first, length=n_links)
    reached = reachable & jnp.isfinite(cost)
    status = jnp.where(driving, Status.TOO_LONG, jnp.where(reached, Status.OK, Status.UNREACHABLE))
    return Route(links, valid, change, legs, cost, status.astype(jnp.int32))
