"""A search with its bar and its checkpoints: what was cut off goes on, bit for bit."""

import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from experiments.tune.study import TuneStudy
from urbanjax.evaluation.scores import ScoreParams
from urbanjax.io.runs import progress
from urbanjax.io.runs.checkpoints import read_checkpoint, write_checkpoint
from urbanjax.io.runs.directory import Run, digest
from urbanjax.io.runs.sweeps.code import code_digest
from urbanjax.planning.learned import initial
from urbanjax.planning.micro import MICRO_TERMS
from urbanjax.rollout import LoopParams
from urbanjax.tuning import Training, space
from urbanjax.tuning.starts import scene_set
from urbanjax.tuning.training import Epoch
from urbanjax.types import ConfigError, as_arrays, host_record
from urbanjax.types.errors import NotFiniteError, TuningError

CHECKPOINT, EPOCHS = "checkpoint.safetensors", "epochs.json"
MUCH, LEAST = 10.0, 0.1  # m of cost, at weights of at least this: what the network is told as much of a term


@host_record
class Searched:
    """A search that has ended, and what happened meanwhile."""

    search: Training
    epochs: tuple[Epoch, ...]
    seconds: tuple[float, ...]  # of each epoch, compiling apart where nothing was compiled
    multiple: float  # of a loss with its gradient, in losses as deployed; 1 where no gradient is needed


def searched(study: TuneStudy, run: Run, *, scores: Sequence[ScoreParams] | None = None) -> Searched:
    """The search that a study asks for, to its end. Its checkpoint is written after every epoch.

    Args: run, where it is written; scores, one for each restart. Raises ConfigError for a run to resume that is of
    another config or code, and TuningError, with the place of the last checkpoint, where something is not finite.
    """
    stamp = {"config": digest(_own(run.resolved)), "code": code_digest()}
    state, epochs, seconds = _known(study.resume, stamp)
    base, params = begun(study), study.training
    with progress.bar("tuning") as tick:
        tick("driving to where scenes begin")
        horizon = float(params.horizons[-1])
        learned, judged = (
            scene_set(base, which, horizon=horizon, seed=params.seed + number)
            for number, which in enumerate((study.learned, study.judged))
        )
        tuned = space(base, study.tuned, network=study.network)
        search = Training(tuned, params, learned=learned, judged=judged, scores=scores or study.score, state=state)
        tick("compiling")
        began, going = time.perf_counter(), search.run()
        while (epoch := _next(going, run)) is not None:
            now = time.perf_counter()
            epochs, seconds, began = [*epochs, epoch], [*seconds, now - began], now
            write_checkpoint(run.path(CHECKPOINT), search.state(), about={**stamp, "epochs": _text(epochs, seconds)})
            tick(_told(epochs, params.generations), search.generation / params.generations)
        tick("measuring what a gradient costs")
        multiple = search.cost_of_gradient()
    return Searched(search, tuple(epochs), tuple(seconds), multiple)


def begun(study: TuneStudy) -> LoopParams:
    """The loop that a search begins with, with a learned cost that adds nothing yet where the study tunes one."""
    loop: LoopParams = as_arrays(study.loop())
    if not study.network:
        return loop
    planning = loop.stack.planning
    weights = jnp.stack([jnp.asarray(getattr(planning.micro.weights, term)) for term in MICRO_TERMS])
    learned = initial(jax.random.key(study.training.seed), MUCH / jnp.maximum(weights, LEAST))
    planning = planning.replace(micro=planning.micro.replace(learned=learned))
    return loop.replace(stack=loop.stack.replace(planning=planning))


def _next(going: Any, run: Run) -> Epoch | None:
    try:
        return next(going, None)
    except NotFiniteError as error:
        kept = run.path(CHECKPOINT)
        where = f"; the last checkpoint is kept in {kept}" if kept.exists() else ""
        raise TuningError(f"{error}{where}") from error


def _own(config: Any) -> dict[str, Any]:
    """What decides the search, of a config."""
    return {name: value for name, value in config.items() if name not in ("resume", "tested")}


def _known(resume: str, stamp: dict[str, str]) -> tuple[dict[str, np.ndarray] | None, list[Epoch], list[float]]:
    """State, epochs and seconds of a run that was cut off. Raises ConfigError for one of another config or code."""
    if not resume:
        return None, [], []
    path = Path(resume) / CHECKPOINT
    if not path.is_file():
        raise ConfigError(f"resume={resume}: there is no {CHECKPOINT} in it; name the directory of a tuning run")
    state, about = read_checkpoint(path)
    for name, value in stamp.items():
        if about.get(name) != value:
            raise ConfigError(f"resume={resume}: that run was of another {name}; begin anew")
    rows = json.loads(about["epochs"])
    return state, [Epoch(**row["epoch"]) for row in rows], [row["s"] for row in rows]


def _text(epochs: Sequence[Epoch], seconds: Sequence[float]) -> str:
    return json.dumps([{"epoch": vars(epoch), "s": s} for epoch, s in zip(epochs, seconds, strict=True)])


def _told(epochs: Sequence[Epoch], generations: int) -> str:
    """What the bar says: the last loss, and the last score as deployed."""
    last = epochs[-1]
    losses = [epoch.loss for epoch in epochs if epoch.loss is not None]
    judged = [epoch.validation for epoch in epochs if epoch.validation is not None]
    parts = [f"generation {last.generation} of {generations}", f"{last.horizon:.0f} s"]
    parts += [f"loss {losses[-1]:.3f}"] if losses else []
    parts += [f"score {-judged[-1]:.3f} (begun {-judged[0]:.3f}, best {-min(judged):.3f})"] if judged else []
    return ", ".join(parts)
