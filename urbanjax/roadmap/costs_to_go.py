"""What is left to go from every link to many goals: one min-plus relaxation for all of them (Eq. 12)."""

import math
from functools import partial

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Bool, Float, Int

from urbanjax.roadmap.graph import RoadGraph
from urbanjax.roadmap.moves import Moves, RouteParams, moves
from urbanjax.types import pytree

GOALS = 256  # that are relaxed at once: their table stays in the cache
PARTS = (4, 1)  # a quarter of the links is relaxed where it holds all heads, or else all are

# What a way costs, as a tuple of arrays of one shape that is compared from left to right: (cost,) or (changes, cost).
Cost = tuple[Array, ...]


@pytree
class _Chains:
    """Links that have one way on, followed to the first link that has several or none: the head of the chain.

    Most links of a road network have one way on (Seoul: 1,946 of 2,464), so that the relaxation is over few.
    """

    head: Array  # [L] int32, of each link; of a head itself
    way: Cost  # [L] to the head; inf where a circle has none
    jump: Array  # [K, L] int32, the link 2^k steps on, at most the head
    leap: Cost  # [K, L] what that costs


def cost_to_go(
    graph: RoadGraph,
    goal: int | Int[Array, ""],
    *,
    params: RouteParams | None = None,
    changes: bool = True,
    blocked: Bool[Array, "l"] | None = None,
) -> Float[Array, "l"]:
    """`costs_to_go` for one goal. Args: goal, a link; graph, changes, blocked, as there."""
    return costs_to_go(graph, jnp.asarray(goal, jnp.int32)[None], params=params, changes=changes, blocked=blocked)[0]


def costs_to_go(
    graph: RoadGraph,
    goals: Int[Array, "g"],
    *,
    params: RouteParams | None = None,
    changes: bool = True,
    blocked: Bool[Array, "l"] | None = None,
) -> Float[Array, "g l"]:
    """Least cost [m or s] from the start of each link to the end of each goal link, inf where it cannot be reached.

    Eq. 12 read as a minimum over link sequences; the lexicographic search's cost is that of the fewest changes. Not
    differentiable (a loop to the fixpoint).
    Args: graph, the road graph; goals [G], links; changes, whether lane changes are allowed at all; blocked [L], links
    that cannot be driven (None: none).
    """
    params = RouteParams() if params is None else params
    ways, rank, n_heads = _heads_first(moves(graph, params, changes=changes, blocked=blocked))
    costs = _move_costs(ways, params.search == "lexicographic")
    chains = _chains(ways, costs)
    size = max(min(GOALS, len(goals)), 1)
    blocks = jnp.pad(rank[goals], (0, -len(goals) % size), mode="edge").reshape(-1, size)
    found = lax.map(lambda block: _relaxed(ways, costs, chains, n_heads, block)[-1][rank].T, blocks)
    return found.reshape(-1, len(rank))[: len(goals)]


def _heads_first(ways: Moves) -> tuple[Moves, Array, Array]:
    """The same moves with the heads numbered first; the number [L] of each link, and how many are heads."""
    single = jnp.sum(ways.allowed, axis=1) == 1
    order = jnp.argsort(single)
    rank = jnp.zeros_like(order).at[order].set(jnp.arange(len(order)))
    renumbered = ways.replace(
        link=rank[ways.link[order]], allowed=ways.allowed[order], cost=ways.cost[order], drive=ways.drive[order]
    )
    return renumbered, rank, jnp.sum(~single)


def _move_costs(ways: Moves, lexicographic: bool) -> Cost:
    """Cost [L, S + 2] of each move, inf where it is not allowed."""
    cost = jnp.where(ways.allowed, ways.cost, jnp.inf)
    count = jnp.where(ways.allowed, ways.changes[None, :].astype(cost.dtype), jnp.inf)
    return (count, cost) if lexicographic else (cost,)


def _chains(ways: Moves, costs: Cost) -> _Chains:
    """The chains, by doubling the step."""
    own = jnp.arange(len(ways.drive))
    single = jnp.sum(ways.allowed, axis=1) == 1
    only = jnp.argmax(ways.allowed, axis=1)
    step = jnp.where(single, ways.link[own, only], own), tuple(jnp.where(single, x[own, only], 0) for x in costs)

    def double(now: tuple[Array, Cost], _: None) -> tuple[tuple[Array, Cost], tuple[Array, Cost]]:
        jump, leap = now
        return (jump[jump], _plus(leap, _rows(leap, jump))), now

    (head, way), (jump, leap) = lax.scan(double, step, length=max(math.ceil(math.log2(len(own))), 1))
    return _Chains(head, tuple(jnp.where(single[head], jnp.inf, x) for x in way), jump, leap)


def _relaxed(ways: Moves, costs: Cost, chains: _Chains, n_heads: Array, goals: Int[Array, "b"]) -> Cost:
    """Cost [L, B] from each link to each goal; goals come last, so that what is looked up are whole rows."""
    at_goal = jnp.arange(len(ways.drive))[:, None] == goals[None, :]
    drive = jnp.broadcast_to(ways.drive[:, None], at_goal.shape)
    changes = jnp.where(jnp.isfinite(drive), 0, jnp.inf)
    now = tuple(jnp.where(at_goal, x, jnp.inf) for x in (changes, drive)[-len(costs) :])

    def along(k: Array, now: Cost) -> Cost:
        return _least(now, _plus(_rows(now, chains.jump[k]), tuple(x[k][:, None] for x in chains.leap)))

    # Goals within a link's own chain, from twice as far each time; then, from the heads, by way of other heads.
    now = lax.fori_loop(0, chains.jump.shape[0], along, now)
    sizes = [-(-len(ways.drive) // part) for part in PARTS]
    fits = jnp.sum(n_heads > jnp.array(sizes))
    heads = lax.switch(fits, [partial(_between, size) for size in sizes], ways.link, costs, chains, now)
    return _least(now, _plus(_rows(heads, chains.head), tuple(x[:, None] for x in chains.way)))


def _between(size: int, link: Array, costs: Cost, chains: _Chains, now: Cost) -> Cost:
    """Cost [L, B], right for the first `size` links, among which all heads are, from what the chains alone give."""
    link, costs = link[:size], tuple(x[:size] for x in costs)
    via, way = chains.head[link], _plus(costs, _rows(chains.way, link))
    first = _over_moves(tuple(x[:size] for x in now), now, link, costs)

    def improve(carry: tuple[Cost, Array]) -> tuple[Cost, Array]:
        heads = _over_moves(carry[0], carry[0], via, way)
        return heads, jnp.any(_less(heads, carry[0]))

    heads, _ = lax.while_loop(lambda carry: carry[1], improve, (first, jnp.asarray(True)))
    return tuple(lax.dynamic_update_slice_in_dim(x, y, 0, 0) for x, y in zip(now, heads, strict=True))


def _over_moves(best: Cost, there: Cost, link: Array, costs: Cost) -> Cost:
    """The least of what is known and of all moves, given the costs of the links that they lead to."""
    for m in range(link.shape[1]):
        best = _least(best, _plus(_rows(there, link[:, m]), tuple(x[:, m, None] for x in costs)))
    return best


def _rows(cost: Cost, which: Array) -> Cost:
    return tuple(x[which] for x in cost)


def _plus(a: Cost, b: Cost) -> Cost:
    return tuple(x + y for x, y in zip(a, b, strict=True))


def _less(a: Cost, b: Cost) -> Array:
    less = a[0] < b[0]
    return less if len(a) == 1 else less | ((a[0] == b[0]) & (a[1] < b[1]))


def _least(a: Cost, b: Cost) -> Cost:
    if len(a) == 1:
        return (jnp.minimum(a[0], b[0]),)
    less = _less(a, b)
    return tuple(jnp.where(less, x, y) for x, y in zip(a, b, strict=True))
