"""Parameters tuned in closed loops, in one call (host side)."""

import collections
import dataclasses
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp

from urbanjax.evaluation import statistics
from urbanjax.evaluation.statistics import WithInterval
from urbanjax.rollout import LoopParams
from urbanjax.tuning.scenes import SceneParams
from urbanjax.tuning.spaces import space
from urbanjax.tuning.starts import scene_set
from urbanjax.tuning.training import Training
from urbanjax.tuning.training_params import TrainingParams
from urbanjax.types import ConfigError, as_arrays, host_record
from urbanjax.types.arguments import kind

OTHERS = SceneParams(traffic=("assertive",), roads=(12, 13, 14, 15), count=48)  # to be judged by


@host_record
class Tuned:
    """What a search came to."""

    values: dict[str, Any]  # by dotted key, as a parameter file holds them
    params: LoopParams  # with them
    gain: WithInterval  # of the mean score in the scenes that it was judged by: of the luckiest point, so hopeful
    training: Training  # with all that happened


def tune(
    patterns: Sequence[str],
    *,
    missions: Sequence[str] = ("overtake",),
    params: LoopParams | None = None,
    training: TrainingParams | None = None,
    learned: SceneParams | None = None,
    judged: SceneParams | None = None,
) -> Tuned:
    """Numbers of the loop tuned by gradient of its score, and what they gain as deployed where they were not tuned.

    Args: patterns, dotted keys with `*` and `?`, see `space`; missions, names in `evaluation.missions.MISSIONS`;
    params, to begin with; training, how; learned, scenes to learn from (default: of the missions, on 12 of their 16
    roads); judged, others that decide which point is best and when to stop (default: on the other roads, among other
    traffic). Raises ConfigError for what there is not, and NotFiniteError where a gradient is not finite.
    """
    params = LoopParams() if params is None else params
    training = TrainingParams() if training is None else training
    for name, value, wanted in (("params", params, LoopParams), ("training", training, TrainingParams)):
        kind(value, name, wanted=wanted, error=ConfigError)
    learned = learned or SceneParams(missions=tuple(missions))
    judged = judged or dataclasses.replace(OTHERS, missions=tuple(missions))
    base = as_arrays(params.loop())
    tuned, last = space(base, patterns), float(training.horizons[-1])
    sets = [
        scene_set(base, which, horizon=last, seed=training.seed + number)
        for number, which in enumerate((learned, judged))
    ]
    search = Training(tuned, training, learned=sets[0], judged=sets[1])
    collections.deque(search.run(), maxlen=0)  # to its end
    return outcome(search, base)


def outcome(search: Training, base: LoopParams) -> Tuned:
    """What a search has come to so far. Args: search, that has judged once; base, the params that it began with."""
    z, losses = search.best
    z = jnp.asarray(z, jnp.float32)
    return Tuned(
        values=search.space.values(z),
        params=search.space.params(z, base),
        gain=statistics.paired(search.first, losses, groups=roads(search)),
        training=search,
    )


def roads(search: Training) -> list[str]:
    """The road of every scene that a search is judged by, since scenes of one road depend on each other.

    Args: search.
    """
    return [scene.road for scene in search.judged.scenes]
