"""The EPDMS of a whole drive: cut into windows of 4 s, each scored, their mean taken."""

import jax
import jax.numpy as jnp
from jax import Array

from urbanjax.evaluation.facts import Facts
from urbanjax.evaluation.metrics import HARD
from urbanjax.evaluation.scores import epdms
from urbanjax.evaluation.scores.epdms import EpdmsScore
from urbanjax.evaluation.scores.epdms_terms import EpdmsParams
from urbanjax.numerics.soft import Relaxation
from urbanjax.types import pytree
from urbanjax.vehicle.params import VehicleParams

PERIOD = 0.1  # s, of the steps that the score is defined on
STEPS = 41  # of a window of 4 s, both of its ends included
HISTORY = 15  # steps before a window that comfort is told from too


@pytree
class EpdmsDrive:
    """What the windows of a drive come to."""

    mean: EpdmsScore  # of those that count
    windows: Array  # [] int32, how many do


def windows(drive: Facts, *, every: int = STEPS - 1) -> tuple[Facts, Facts]:
    """The windows [K, 41] of a drive and the steps [K, 15] before each, as facts.

    Where the drive has ended, or not begun yet, they are not alive. Args: drive [T], facts of it; every, steps from
    the start of a window to that of the next one.
    """
    total = drive.time.shape[0]
    starts = jnp.arange(0, max(total - STEPS, 0) + 1, every)

    def cut(first: Array, count: int) -> Facts:
        rows = first + jnp.arange(count)
        known = (rows >= 0) & (rows < total)
        part = jax.tree.map(lambda x: jnp.take(x, rows, axis=0, mode="clip") if jnp.ndim(x) else x, drive)
        return part.replace(alive=part.alive & known)

    return jax.vmap(lambda start: (cut(start, STEPS), cut(start - HISTORY, HISTORY)))(starts)


def driven(
    drive: Facts,
    vehicle: VehicleParams,
    *,
    references: Facts,
    every: int = STEPS - 1,
    params: EpdmsParams | None = None,
    relaxation: Relaxation = HARD,
) -> EpdmsDrive:
    """The mean over the windows of a drive that are whole; one that is shorter is scored on what there is.

    Args: drive [T], facts of it in steps of 0.1 s; vehicle, the ego's dimensions; references [K, 41], facts of what the
    reference driver did from the start of each window; every, steps from the start of a window to that of the next;
    params, thresholds and weights; relaxation, hard or how soft.
    """
    cuts = windows(drive, every=every)

    def one(window: Facts, before: Facts, theirs: Facts) -> EpdmsScore:
        theirs = theirs.replace(alive=window.alive)
        reference = epdms.gated_way(theirs, vehicle, params=params, relaxation=relaxation)
        return epdms.score(window, vehicle, reference=reference, before=before, params=params, relaxation=relaxation)

    scores = jax.vmap(one)(*cuts, references)
    whole = jnp.all(cuts[0].alive, axis=1)
    counts = whole.at[0].set(True)
    number = jnp.sum(counts, dtype=jnp.int32)
    return EpdmsDrive(jax.tree.map(lambda x: jnp.sum(jnp.where(counts, x, 0)) / number, scores), number)
