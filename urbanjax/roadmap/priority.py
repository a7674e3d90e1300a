"""Who goes first where ways meet, as the road graph states it: one reading for the driver and for simulated traffic."""

from jax import Array
from jaxtyping import Float, Int

from urbanjax.roadmap.graph import Rule, Turn


def rank(rule: Int[Array, "*s"], turn: Int[Array, "*s"], *, like: Float[Array, "..."]) -> Float[Array, "*s"]:
    """How many ranks below priority who enters a junction is: one for a yield or stop sign, one for a left or U-turn.

    Args: rule [*s], a Rule, at the end of the link that is left; turn [*s], a Turn, of the link that is entered; like,
    of the dtype of the result.
    """
    turns = (turn == Turn.LEFT) | (turn == Turn.U_TURN)
    return (rule != Rule.NONE).astype(like.dtype) + turns.astype(like.dtype)
