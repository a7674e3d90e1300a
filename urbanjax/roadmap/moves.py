"""The ways to leave each link of the road graph, and what they cost (the edges of Eq. 12)."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.roadmap.graph import RoadGraph
from urbanjax.types import pytree, static

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
    n_links: int = static(default=256, metadata={"range": (1, 2**20)})  # R, the longest route


@pytree
class Moves:
    """The ways to leave each link: S successors, then the left and the right neighbour."""

    link: Array  # [L, S + 2] int32
    allowed: Array  # [L, S + 2] bool
    cost: Array  # [L, S + 2] m or s
    changes: Array  # [S + 2] int32, 1 for a lane change where the search counts them
    drive: Array  # [L] m or s, from the start of each link to its end; inf where it is blocked


def link_costs(graph: RoadGraph, params: RouteParams) -> Float[Array, "l"]:
    """Cost of driving each link from end to end: its length [m] or, at the speed limit, its time [s].

    Args: graph, the road graph.
    """
    return graph.length if params.cost == "length" else graph.length / graph.speed_limit


def moves(
    graph: RoadGraph, params: RouteParams, *, changes: bool = True, blocked: Bool[Array, "l"] | None = None
) -> Moves:
    """All ways to leave each link.

    A blocked link cannot be driven: nothing leads into it, and whoever is on it leaves it by a lane change only.
    Args: graph, the road graph; changes, whether lane changes are allowed at all; blocked [L], None for none.
    """
    weight = link_costs(graph, params)
    penalty = params.change_length if params.cost == "length" else params.change_time
    # A negative penalty would make the relaxation run for ever.
    penalty = jnp.maximum(jnp.asarray(0.0 if params.search == "lexicographic" else penalty, weight.dtype), 0)
    free = jnp.ones_like(graph.valid) if blocked is None else ~blocked
    s = graph.successor.shape[1]
    sides = [
        (graph.left_link, graph.has_left & graph.left_change & changes),
        (graph.right_link, graph.has_right & graph.right_change & changes),
    ]
    link = jnp.concatenate([graph.successor, *(side[:, None] for side, _ in sides)], axis=1)
    allowed = jnp.concatenate([graph.has_successor & free[:, None], *(ok[:, None] for _, ok in sides)], axis=1)
    return Moves(
        link=link,
        allowed=allowed & graph.valid[:, None] & (graph.valid & free)[link],
        cost=jnp.concatenate(
            [jnp.broadcast_to(weight[:, None], graph.successor.shape), jnp.full((len(weight), 2), penalty)], axis=1
        ),
        changes=jnp.concatenate(
            [jnp.zeros(s, jnp.int32), jnp.full(2, int(params.search == "lexicographic"), jnp.int32)]
        ),
        drive=jnp.where(free, weight, jnp.inf),
    )
