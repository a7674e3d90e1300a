"""The best way from every link to one goal, move by move: the table that a route is traced on (Eq. 12)."""

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Bool, Int

from urbanjax.roadmap.moves import Moves
from urbanjax.types import pytree


@pytree
class Potential:
    """The best way from each link to a goal; compared by `changes` first, then by `cost`."""

    changes: Array  # [L] int32, lane changes (0 in all but the lexicographic search)
    cost: Array  # [L] m or s, from the start of the link to the end of the goal; inf where unreachable
    move: Array  # [L] int32, the first move; at the goal, the one that leads back to it
    circuit: Array  # [] m or s, from the start of the goal around to its end; inf where no successor leads back


def potential(moves: Moves, goal: Int[Array, ""]) -> Potential:
    """The fixpoint of the min-plus relaxation towards the goal.

    A move is kept until a strictly better one is found, so that moves never form a cycle, not even at zero penalty.
    Args: moves, the ways to leave each link; goal, a link.
    """
    at_goal = jnp.arange(len(moves.drive)) == goal
    start = Potential(
        changes=jnp.where(at_goal, 0, jnp.iinfo(jnp.int32).max // 2 * jnp.max(moves.changes)),
        cost=jnp.where(at_goal, moves.drive, jnp.inf),
        move=jnp.zeros(len(moves.drive), jnp.int32),
        circuit=jnp.asarray(jnp.inf, moves.drive.dtype),
    )

    def improve(carry: tuple[Potential, Array]) -> tuple[Potential, Array]:
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


def _best(moves: Moves, allowed: Bool[Array, "l m"], now: Potential) -> tuple[Array, Array, Array]:
    """The best allowed move of each link, given the potential of the links it leads to: changes, cost, move."""
    there = moves.link
    open_ = allowed & jnp.isfinite(now.cost[there])
    changes = jnp.where(open_, moves.changes[None, :] + now.changes[there], jnp.iinfo(jnp.int32).max)
    fewest = jnp.min(changes, axis=1)
    cost = jnp.where(open_ & (changes == fewest[:, None]), moves.cost + now.cost[there], jnp.inf)
    return fewest, jnp.min(cost, axis=1), jnp.argmin(cost, axis=1).astype(jnp.int32)
