"""Tuning in closed loops: learn from some scenes, judge by others as deployed, end when that gets no better."""

import dataclasses
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from urbanjax.evaluation.scores import ScoreParams
from urbanjax.numerics.soft import Relaxation
from urbanjax.tuning.cma_es import CmaEs
from urbanjax.tuning.evolution import COUNT, cosine_to_evolution
from urbanjax.tuning.gradient_descent import GradientDescent
from urbanjax.tuning.losses.closed_loop import ClosedLoop, Rows
from urbanjax.tuning.losses.risk import tail_weights
from urbanjax.tuning.optimiser import Optimiser, replayed
from urbanjax.tuning.random_search import RandomSearch
from urbanjax.tuning.spaces import Space
from urbanjax.tuning.starts import SceneSet
from urbanjax.tuning.tpe import Tpe
from urbanjax.tuning.training_params import TrainingParams
from urbanjax.types import host_record
from urbanjax.types.errors import NotFiniteError, TuningError

LEARN, JUDGE = 0, 1  # purposes of seeds


@host_record
class Epoch:
    """What came of a generation, or of a validation before it."""

    generation: int
    horizon: float  # s
    evaluations: int  # points so far, each in all scenes of a generation
    loss: float | None = None  # mean over points and scenes
    gradient_norm: float | None = None  # of the mean over scenes, the greatest of all points
    validation: float | None = None  # hard loss of the best standing point
    cosine: float | None = None  # to an evolution strategy's gradient at the next horizon


@host_record
class Check:
    """What came of a validation."""

    generation: int  # before which
    z: np.ndarray  # [K, P], the standing points
    losses: np.ndarray  # [K, V], hard
    cosine: float  # to an evolution strategy's gradient at the next horizon; NaN where it was not asked


class Training:
    """A search for the parameters of a space with the least loss in closed loops. `state()` is all that it knows.

    Points with scores of their own (`scores`) are one search each: a front is one batch.
    """

    def __init__(
        self,
        space: Space,
        params: TrainingParams,
        *,
        learned: SceneSet,
        judged: SceneSet,
        scores: ScoreParams | Sequence[ScoreParams] | None = None,
        state: Mapping[str, np.ndarray] | None = None,
        start: np.ndarray | None = None,
    ) -> None:
        """A search that has not begun, or has come as far as its state says.

        Args: space, of the parameters; params; learned, scenes to learn from; judged, others to be judged by, as
        deployed; scores, one for all, or one for each restart (default: the standard one for all); state, of a search
        that was cut off; start [P], where to begin (default: at 0, the params as they are). Raises TuningError for a
        state that is of another search, and ConfigError for settings that exclude each other.
        """
        self.space, self.params, self.learned, self.judged = space, params, learned, judged
        self.period = float(np.asarray(learned.start.loop.period).flat[0])
        self.steps = params.steps(self.period)
        self.score = scores if isinstance(scores, ScoreParams) else None
        self.scores = None if scores is None or isinstance(scores, ScoreParams) else list(scores)
        self.optimiser = self._begun(np.zeros(space.size) if start is None else np.asarray(start, float))
        self.horizon = 0  # number of the present one
        self.marks: list[int] = []  # evaluations at the end of each generation
        self.checks: list[Check] = []
        if state is not None:
            self._restore(state)

    @property
    def generation(self) -> int:
        """Generations that are done."""
        return len(self.marks)

    @property
    def best(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the points that were judged, the one with the least mean loss: z [P], and its hard losses [V]."""
        z, losses = self._judged()
        k = int(np.argmin(losses.mean(-1)))
        return z[k], losses[k]

    @property
    def first(self) -> np.ndarray:
        """The hard losses [V] of where the search began."""
        return self.checks[0].losses[0]

    @property
    def ended(self) -> bool:
        """Whether all generations are done, or the last validations have found nothing better."""
        if self.generation >= self.params.generations:
            return len(self.checks) > 0 and self.checks[-1].generation == self.generation
        if not self.checks:
            return False
        means = np.stack([check.losses.mean(-1) for check in self.checks])  # [C, K]
        means = means.min(1, keepdims=True) if self.scores is None else means  # a front ends with its last search
        return len(means) - 1 - int(np.argmin(means, axis=0).max()) >= self.params.patience

    def run(self) -> Iterator[Epoch]:
        """Every validation and generation as it is done, up to the end.

        Raises NotFiniteError where a loss or gradient is not finite, with generation, parameter and scene.
        """
        while not self.ended:
            due = self.generation % self.params.every == 0 or self.generation >= self.params.generations
            if due and not (self.checks and self.checks[-1].generation == self.generation):
                yield self._judge()
            if not self.ended and self.generation < self.params.generations:
                yield self.learn()

    def look(self) -> np.ndarray:
        """Hard losses [K, V] of the points that the search stands by, in the scenes to be judged by."""
        z, every = self.optimiser.standing(), np.arange(len(self.judged.scenes))
        rows = self._rows(z, self.judged, every, self.steps[-1], graded=False)
        return rows.loss.reshape(len(z), len(every))

    def cost_of_gradient(self, repeats: int = 3) -> float:
        """How many losses as deployed one with its gradient costs, at the longest horizon; 1 where none is needed.

        Args: repeats, of which the median is taken, warm.
        """
        if not self.optimiser.needs_gradient:
            return 1.0
        chosen, z = self._drawn(0), self.optimiser.standing()[:1]

        def seconds(graded: bool) -> float:
            times = []
            for _ in range(repeats + 1):
                began = time.perf_counter()
                self._rows(z, self.learned, chosen, self.steps[-1], graded, own=[0])
                times.append(time.perf_counter() - began)
            return float(np.median(times[1:]))

        return seconds(True) / seconds(False)

    def state(self) -> dict[str, np.ndarray]:
        """What has to be kept to go on: plain arrays by name."""
        kept = {f"history.{name}": rows for name, rows in self.optimiser.history().items()}
        kept |= {"marks": np.array(self.marks, np.int64), "horizon": np.array(self.horizon, np.int64)}
        for spec in dataclasses.fields(Check):
            kept[f"checks.{spec.name}"] = np.array([getattr(check, spec.name) for check in self.checks])
        return kept

    def _restore(self, state: Mapping[str, np.ndarray]) -> None:
        try:
            history = {name.removeprefix("history."): x for name, x in state.items() if name.startswith("history.")}
            self.optimiser = replayed(self.optimiser, history)
            self.marks, self.horizon = np.asarray(state["marks"]).tolist(), int(state["horizon"])
            columns = [state[f"checks.{spec.name}"] for spec in dataclasses.fields(Check)]
        except KeyError as error:
            raise TuningError(f"the state lacks {error}: is it that of a search?") from error
        self.checks = [Check(int(g), z, losses, float(cosine)) for g, z, losses, cosine in zip(*columns, strict=True)]

    def _begun(self, start: np.ndarray) -> Optimiser:
        params = self.params
        common: dict[str, Any] = {"sigma": float(params.sigma), "seed": params.seed}
        if params.optimiser != "gradient":
            if self.scores is not None:
                raise TuningError(f"'{params.optimiser}' minimises one score at a time: take 'gradient' for several")
            return {"cma_es": CmaEs, "tpe": Tpe, "random": RandomSearch}[params.optimiser](start, **common)
        return GradientDescent(
            start,
            **common,
            restarts=params.restarts if self.scores is None else len(self.scores),
            rate=float(params.rate),
            clip=float(params.clip),
            steps=params.generations,
            together=self.scores is not None,
        )

    def learn(self) -> Epoch:
        """One generation. Raises NotFiniteError."""
        chosen = self._drawn(self.generation)
        z = self.optimiser.ask()
        graded = self.optimiser.needs_gradient
        rows = self._rows(z, self.learned, chosen, self.steps[self.horizon], graded)
        losses = rows.loss.reshape(len(z), len(chosen))
        gradients = _clipped(rows.gradient, float(self.params.scene_clip)).reshape(*losses.shape, -1)
        shares = np.asarray(tail_weights(jnp.asarray(losses), float(self.params.risk)))
        together = np.sum(shares * losses, axis=1)
        slopes = np.einsum("ns,nsp->np", shares, gradients)
        self.optimiser.tell(z, together, gradients=slopes if graded else None)
        self.marks.append(self.optimiser.evaluations)
        norm = float(np.linalg.norm(slopes, axis=1).max()) if graded else None
        return self._epoch(loss=float(together.mean()), gradient_norm=norm)

    def _judge(self) -> Epoch:
        """Hard losses of the standing points in the scenes to be judged by, and whether the horizon may grow."""
        z, losses = self.optimiser.standing(), self.look()
        cosine = float("nan")
        if self.optimiser.needs_gradient and self.horizon + 1 < len(self.steps) and self.generation:
            cosine = self._cosine(z[0])
            self.horizon += cosine > float(self.params.least_cosine)
        self.checks.append(Check(self.generation, z, losses, cosine))
        least = float(losses.mean(-1).min())
        return self._epoch(validation=least, cosine=None if np.isnan(cosine) else cosine)

    def _cosine(self, z: np.ndarray) -> float:
        """Between the gradient at the next horizon and what losses as deployed do there."""
        chosen, steps = self._drawn(self.generation), self.steps[self.horizon + 1]
        gradient = _clipped(
            self._rows(z[None], self.learned, chosen, steps, graded=True, own=[0]).gradient,
            float(self.params.scene_clip),
        )

        def loss(points: np.ndarray) -> np.ndarray:
            found = self._rows(points, self.learned, chosen, steps, graded=False, own=[0] * len(points)).loss
            return found.reshape(len(points), -1).mean(-1)

        return cosine_to_evolution(
            loss,
            z,
            gradient=gradient.mean(0),
            sigma=float(self.params.sigma) / 3,
            seed=self.params.seed + self.generation,
            count=COUNT,
        )

    def _rows(
        self,
        z: np.ndarray,
        where: SceneSet,
        chosen: np.ndarray,
        steps: int,
        graded: bool,
        own: Sequence[int] | None = None,
    ) -> Rows:
        """The points [N, P], each in all the chosen scenes, row by row. Raises NotFiniteError.

        `own` says whose score each is of (default: one after the other).
        """
        params = self.params
        relaxation = Relaxation(params.temperature(self.generation), params.mode) if graded else Relaxation()
        scores: Any = self.score
        if self.scores is not None:
            scores = [self.scores[k] for k in (range(len(z)) if own is None else own) for _ in chosen]
        rows = ClosedLoop(self.space, self.steps[-1], float(self.params.step_clip)).losses(
            np.repeat(z, len(chosen), axis=0),
            where.start.at(np.tile(chosen, len(z))),
            n_steps=steps,
            score=scores,
            relaxation=relaxation,
            derivative=params.derivative if graded else "none",
        )
        bad = np.concatenate([rows.loss[:, None], rows.gradient], axis=1)
        for row, column in np.argwhere(~np.isfinite(bad)):
            raise NotFiniteError(
                generation=self.generation,
                parameter=self.space.keys[column - 1] if column else "",
                scene=str(where.scenes[chosen[row % len(chosen)]]),
            )
        return rows

    def _drawn(self, generation: int) -> np.ndarray:
        """Numbers of the scenes of a generation: others each time, where the search does not compare generations."""
        there, count = len(self.learned.scenes), self.params.scenes
        draw = 0 if self.optimiser.compares_generations else generation
        rng = np.random.default_rng([self.params.seed, LEARN, draw])
        return rng.choice(there, min(count, there), replace=False)

    def _judged(self) -> tuple[np.ndarray, np.ndarray]:
        if not self.checks:
            raise TuningError("nothing has been judged yet: take at least one step of `run()`")
        z, losses = ([getattr(check, name) for check in self.checks] for name in ("z", "losses"))
        return np.concatenate(z), np.concatenate(losses)

    def _epoch(self, **found: Any) -> Epoch:
        horizon = self.steps[self.horizon] * self.period
        return Epoch(self.generation, horizon, self.optimiser.evaluations, **found)


def _clipped(gradients: np.ndarray, most: float) -> np.ndarray:
    """Gradients [R, P] whose norm is at most so large."""
    norm = np.linalg.norm(gradients.astype(np.float64), axis=1, keepdims=True)
    return gradients * (most / np.maximum(norm, most))
