"""A closed loop that is differentiated through many steps."""

import jax
from jax import Array

from urbanjax.evaluation.case import Case
from urbanjax.numerics.clipping import clip_cotangent
from urbanjax.numerics.kept import recomputed
from urbanjax.rollout import LoopParams, Underway, one_step
from urbanjax.sim.log import Log


def unrolled(
    loop: LoopParams, case: Case, *, now: Underway, n_steps: int, step_clip: Array | float | None
) -> tuple[Underway, Log]:
    """`n_steps` more of a loop, as `rollout.go_on`: where it stands, and the log [T] of them.

    Args: loop; case, what the drive is about; now, the loop so far; n_steps; step_clip [], greatest norm of what a step
    hands back to the one before in reverse mode (None: any, and forward mode differentiates too).
    """
    step = one_step(loop, case.course, lanes=case.lanes, keep=lambda info: None)

    def body(so_far: Underway, _: None) -> tuple[Underway, Log]:
        after, (entry, _) = step(so_far if step_clip is None else clip_cotangent(so_far, step_clip))
        return after, entry

    return jax.lax.scan(recomputed(body), now, length=n_steps)
