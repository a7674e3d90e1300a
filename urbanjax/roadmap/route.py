"""Routes over the road graph: a min-plus relaxation from the goal and a trace-back from the start (Eq. 12)."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jaxtyping import Bool, Float, Int

from urbanjax.roadmap.graph import RoadGraph
from urbanjax.types import RouteError, RouteStatus, pytree, static

SEARCHES = ("sum", "lexicographic", "two_stage")
COSTS = ("length", "time")


@pytree
class RouteParams:
    """What a route costs, and how lane changes count.

    `sum` adds a penalty per lane change; `lexicographic` minimises the number of changes first and the length or time
    second; `two_stage` takes the shortest route without any change where one exists, and `sum` otherwise (the paper's
    fall-back to parallel links).
    """

    change_length: float = 50.0  # m, penalty of a lane change where the cost is length
    change_time: float = 5.0  # s, where it is time
    cost: str = static(default="length", metadata={"choices": COSTS})
    search: str = static(default="sum", metadata={"choices": SEARCHES})
    n_links: int = static(default=256)  # R, the longest route


@pytree
class Route:
    """Links in driving order, padded to R."""

    link: Array  # [R] int32
    valid: Array  # [R] bool
    change: Array  # [R] bool, the next link is entered by a lane change, not at the end of this one
    cost: Array  # [] m or s, with the penalties (in `lexicographic` without)
    status: Array  # [] int32, a RouteStatus


@pytree
class _Moves:
    """The ways to leave each link: S successors, then the left and the right neighbour."""

    link: Array  # [L, S + 2] int32
    allowed: Array  # [L, S + 2] bool
    cost: Array  # [L, S + 2] m or s
    changes: Array  # [S + 2] int32, 1 for a lane change


@pytree
class _Potential:
    """The best way from each link to a goal; compared by `changes` first, then by `cost`."""

    changes: Array  # [L] int32, lane changes (0 in all but the lexicographic search)
    cost: Array  # [L] m or s, from the start of the link to the end of the goal; inf where unreachable
    move: Array  # [L] int32, the first move; at the goal, the one that leads back to it
    circuit: Array  # [] m or s, from the start of the goal around to its end; inf where no successor leads back


def link_costs(graph: RoadGraph, params: RouteParams) -> Float[Array, "l"]:
    """Cost of driving each link from end to end: its length [m] or, at the speed limit, its time [s]."""
    return graph.length if params.cost == "length" else graph.length / graph.speed_limit


def cost_to_go(
    graph: RoadGraph, goal: int | Int[Array, ""], params: RouteParams | None = None, changes: bool = True
) -> Float[Array, "l"]:
    """Least cost [m or s] from the start of each link to the end of the goal link, inf where it cannot be reached.

    Eq. 12 read as a minimum over link sequences. Not differentiable (a loop to the fixpoint).
    Args: goal, a link; changes, whether lane changes are allowed at all.
    """
    params = RouteParams() if params is None else params
    return _relax(_moves(graph, params, changes), link_costs(graph, params), jnp.asarray(goal)).cost


def plan_route(
    graph: RoadGraph,
    start: int | Int[Array, ""],
    goal: int | Int[Array, ""],
    via: tuple[Any, ...] = (),
    laps: int = 1,
    params: RouteParams | None = None,
) -> Route:
    """The cheapest route from the start of link `start` to the end of link `goal` (Eq. 12).

    It visits the links `via` in order, then the goal; with more than one lap this circuit is driven `laps` times. Each
    leg moves on by at least one link, but for a plain route whose start is its goal, which has that one link. Legs are
    optimal one by one; of lane changes at equal cost the latest is taken, but for rounding. Failure is in `status`:
    UNREACHABLE, or TOO_LONG for the R links of `params`; what was found until then is kept.
    """
    params = RouteParams() if params is None else params
    weight = link_costs(graph, params)
    targets = jnp.stack([jnp.asarray(link, jnp.int32) for link in (*via, goal)])
    moves = _moves(graph, params, changes=True)
    variants = [moves] if params.search != "two_stage" else [_moves(graph, params, changes=False), moves]
    tables = [lax.map(lambda target, m=m: _relax(m, weight, target), targets) for m in variants]
    must_move = bool(via) or laps > 1
    return _trace(
        moves, jax.tree.map(lambda *x: jnp.stack(x), *tables), weight, start, targets, laps, must_move, params
    )


def route_between(
    graph: RoadGraph, start: int, goal: int, via: tuple[int, ...] = (), laps: int = 1, params: RouteParams | None = None
) -> Route:
    """`plan_route` for a caller outside jit: raises RouteError, naming the links, where there is no route."""
    params = RouteParams() if params is None else params
    valid = np.asarray(graph.valid)
    for name, link in (("start", start), *(("via", link) for link in via), ("goal", goal)):
        if not 0 <= link < len(valid) or not valid[link]:
            raise RouteError(f"{name} link {link} is not in the road graph: choose one of 0..{valid.sum() - 1}")
    if laps < 1:
        raise RouteError(f"laps is {laps}: use 1 or more")
    if params.cost not in COSTS or params.search not in SEARCHES:
        raise RouteError(f"cost {params.cost!r} or search {params.search!r} is unknown: use one of {COSTS}, {SEARCHES}")
    if not (params.change_length >= 0 and params.change_time >= 0):
        raise RouteError(f"lane-change penalties are {params.change_length} m, {params.change_time} s: use 0 or more")
    route = _plan_jit(graph, start, goal, via, laps, params)
    status = RouteStatus(int(route.status))
    if status == RouteStatus.UNREACHABLE:
        way = "".join(f" via {link}" for link in via)
        raise RouteError(f"link {goal} cannot be reached from link {start}{way}: check successors and lane changes")
    if status == RouteStatus.TOO_LONG:
        raise RouteError(
            f"the route from link {start} to link {goal} has more than {params.n_links} links: raise n_links"
        )
    return route


_plan_jit = jax.jit(plan_route, static_argnames="laps")


def _moves(graph: RoadGraph, params: RouteParams, changes: bool) -> _Moves:
    weight = link_costs(graph, params)
    penalty = params.change_length if params.cost == "length" else params.change_time
    # A negative penalty would make the relaxation run for ever.
    penalty = jnp.maximum(jnp.asarray(0.0 if params.search == "lexicographic" else penalty, weight.dtype), 0)
    s = graph.successor.shape[1]
    sides = [
        (graph.left_link, graph.has_left & graph.left_change),
        (graph.right_link, graph.has_right & graph.right_change),
    ]
    link = jnp.concatenate([graph.successor, *(side[:, None] for side, _ in sides)], axis=1)
    allowed = jnp.concatenate([graph.has_successor, *((ok & changes)[:, None] for _, ok in sides)], axis=1)
    return _Moves(
        link=link,
        allowed=allowed & graph.valid[:, None] & graph.valid[link],
        cost=jnp.concatenate(
            [jnp.broadcast_to(weight[:, None], graph.successor.shape), jnp.full((len(weight), 2), penalty)], axis=1
        ),
        changes=jnp.concatenate(
            [jnp.zeros(s, jnp.int32), jnp.full(2, int(params.search == "lexicographic"), jnp.int32)]
        ),
    )


def _best(moves: _Moves, allowed: Bool[Array, "l m"], now: _Potential) -> tuple[Array, Array, Array]:
    """The best allowed move of each link, given the potential of the links it leads to: changes, cost, move."""
    there = moves.link
    open_ = allowed & jnp.isfinite(now.cost[there])
    changes = jnp.where(open_, moves.changes[None, :] + now.changes[there], jnp.iinfo(jnp.int32).max)
    fewest = jnp.min(changes, axis=1)
    cost = jnp.where(open_ & (changes == fewest[:, None]), moves.cost + now.cost[there], jnp.inf)
    return fewest, jnp.min(cost, axis=1), jnp.argmin(cost, axis=1).astype(jnp.int32)


def _relax(moves: _Moves, weight: Float[Array, "l"], goal: Int[Array, ""]) -> _Potential:
    """The fixpoint of the min-plus relaxation towards the goal.

    A move is kept until a strictly better one is found, so that moves never form a cycle, not even at zero penalty.
    """
    at_goal = jnp.arange(len(weight)) == goal
    start = _Potential(
        changes=jnp.where(at_goal, 0, jnp.iinfo(jnp.int32).max // 2 * jnp.max(moves.changes)),
        cost=jnp.where(at_goal, weight, jnp.inf),
        move=jnp.zeros(len(weight), jnp.int32),
        circuit=jnp.asarray(jnp.inf, weight.dtype),
    )

    def improve(carry: tuple[_Potential, Array]) -> tuple[_Potential, Array]:
        now, _ = carry
        changes, cost, move = _best(moves, moves.allowed, now)
        better = (changes < now.changes) | ((changes == now.changes) & (cost < now.cost))
        better = better & jnp.isfinite(cost)
        found = now.replace(
            changes=jnp.where(better, changes, now.changes),
            cost=jnp.where(better, cost, now.cost),
            move=jnp.where(better, move, now.move),
        )
        return found, jnp.any(better)

    out, _ = lax.while_loop(lambda carry: carry[1], improve, (start, jnp.asarray(True)))
    # Leaving the goal by a lane change and coming back by another is no circuit: only its successors count.
    succession = moves.allowed & (jnp.arange(moves.link.shape[1]) < moves.link.shape[1] - 2)[None, :]
    _, around, leave = _best(moves, succession, out)
    return out.replace(move=jnp.where(at_goal, leave, out.move), circuit=around[goal])


def _trace(
    moves: _Moves,
    tables: _Potential,
    weight: Float[Array, "l"],
    start: int | Int[Array, ""],
    targets: Int[Array, "t"],
    laps: int,
    must_move: bool,
    params: RouteParams,
) -> Route:
    """The route through the targets, `laps` times; `tables` hold one potential per variant and target."""
    n_targets = targets.shape[0]
    n_legs = laps * n_targets

    def choose(link: Array, leg: Array) -> tuple[Array, Array]:
        """The first variant by which the leg can be driven from here, and whether there is one."""
        target = leg % n_targets
        reach = jnp.where(link == targets[target], tables.circuit[:, target], tables.cost[:, target, link])
        return jnp.argmax(jnp.isfinite(reach)), jnp.any(jnp.isfinite(reach))

    def step(carry: tuple[Array, ...], _: None) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        link, leg, moved, variant, cost, driving, reachable = carry
        arrived = (link == targets[leg % n_targets]) & moved
        leg = leg + arrived
        done = leg == n_legs
        fresh, possible = choose(link, leg)
        variant = jnp.where(arrived, fresh, variant)
        possible = jnp.where(arrived, possible, reachable)
        move = tables.move[variant, leg % n_targets, link]
        going = driving & ~done & possible
        spent = jnp.where(going, moves.cost[link, move], jnp.where(driving & done, weight[link], 0))
        out = link, driving, going & (move >= moves.link.shape[1] - 2)
        carry = (
            jnp.where(going, moves.link[link, move], link),
            leg,
            jnp.asarray(True),
            variant,
            cost + spent,
            going,
            jnp.where(driving & ~done, possible, reachable),
        )
        return carry, out

    link = jnp.asarray(start, jnp.int32)
    leg = jnp.asarray(0, jnp.int32)
    variant, possible = choose(link, leg)
    possible = possible | ((link == targets[0]) & (not must_move))
    first = (link, leg, jnp.asarray(not must_move), variant, jnp.zeros((), weight.dtype), jnp.asarray(True), possible)
    (_, _, _, _, cost, driving, reachable), (links, valid, change) = lax.scan(step, first, length=params.n_links)
    status = jnp.where(driving, RouteStatus.TOO_LONG, jnp.where(reachable, RouteStatus.OK, RouteStatus.UNREACHABLE))
    return Route(links, valid, change, cost, status.astype(jnp.int32))
