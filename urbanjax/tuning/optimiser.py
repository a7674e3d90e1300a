"""One protocol for every search over an unconstrained vector z: ask for points, tell their losses (host side).

A search is a function of its settings, its seed and what it was told. So its history, plain arrays, is all that has to
be kept to go on after a kill: whoever goes on makes the optimiser anew and has it `replayed`, which needs no pickle.
"""

import abc
from collections.abc import Mapping
from typing import ClassVar, TypeVar

import numpy as np
from jax import Array

from urbanjax.types import host_record
from urbanjax.types.errors import GradientError, TuningError

Numbers = np.ndarray | Array
SEEDS = 2**32  # of the libraries' generators: from 0 to one less


@host_record
class Incumbent:
    """The best point that a search has been told of."""

    loss: float  # infinite until a finite one is told
    z: np.ndarray  # [P]; the start until then


class Optimiser(abc.ABC):
    """A search for the z [P] of least loss, in generations of N points.

    Losses that are NaN or infinite count as worse than any other, and are counted in `failed`. Where losses of
    different generations are drawn with different seeds, `best` is the luckiest: evaluate it anew before reporting it.
    """

    needs_gradient: ClassVar[bool] = False  # whether `tell` takes gradients, which cost more than losses
    compares_generations: ClassVar[bool] = False  # whether losses of different ones are, which then must be alike

    def __init__(self, start: Numbers, *, sigma: float, seed: int) -> None:
        """A search that has not begun.

        Args: start [P], where it begins; sigma, its initial spread, in units of z; seed, from 0 to 2**32 - 1. Raises
        TuningError for a start that is empty or not finite, and for a sigma or seed out of range.
        """
        self.start = np.array(start, np.float64)
        if self.start.ndim != 1 or not self.start.size or not np.isfinite(self.start).all():
            raise TuningError(f"start has shape {self.start.shape}: give one finite number for each parameter")
        if not 0 < sigma < np.inf:
            raise TuningError(f"sigma is {sigma}: give the spread of the first points, positive and finite")
        if not 0 <= seed < SEEDS:
            raise TuningError(f"seed is {seed}: give one from 0 to {SEEDS - 1}")
        self.sigma, self.seed = float(sigma), int(seed)
        self.evaluations = self.failed = 0
        self.best = Incumbent(np.inf, self.start)
        self._told: list[tuple[np.ndarray, ...]] = []
        self._asked, self._begun = self.start[None][:0], 0  # this generation, and where in `_told` it begins

    @abc.abstractmethod
    def _propose(self) -> np.ndarray:
        """The next generation, [N, P]."""

    @abc.abstractmethod
    def _learn(self, z: np.ndarray, losses: np.ndarray, gradients: np.ndarray) -> None:
        """Take in a whole generation: z [N, P], losses [N], failed ones infinite, gradients ([N, P] or [N, 0])."""

    def standing(self) -> np.ndarray:
        """The points [K, P] that the search would stand by now: what is worth evaluating anew."""
        return self.best.z[None].copy()

    def ask(self) -> np.ndarray:
        """Points to evaluate, [N, P]: the next generation, or what is left to be told of this one."""
        if not self._asked.size:
            self._asked = np.ascontiguousarray(self._propose(), np.float64)
            self._asked.setflags(write=False)
        return self._asked[self._pending :]

    def tell(self, z: Numbers, losses: Numbers, *, gradients: Numbers | None = None) -> None:
        """Take in the losses of the first points that were asked for; the search moves on once it has all of them.

        So a search whose budget ends within a generation goes on from there as if it had never ended.
        Args: z [n, P], the first n points of `ask()`; losses [n]; gradients [n, P], where `needs_gradient`. Raises
        TuningError for other points or shapes, and GradientError for a gradient that is not finite.
        """
        points, values = np.array(z, np.float64, ndmin=1), np.array(losses, np.float64)
        if not len(points) or not _same_bits(points, self.ask()[: len(points)]):
            raise TuningError(
                "these are not the points that were asked for: tell the first ones of `ask()` as they are"
            )
        if values.shape != (len(points),):
            raise TuningError(f"losses of {len(points)} points have shape {values.shape}: give one for each")
        self._record(points, values, self._checked(gradients, points))
        if self._pending == len(self._asked):
            points, values, slopes = (np.concatenate(rows) for rows in zip(*self._told[self._begun :], strict=True))
            self._asked, self._begun = self._asked[:0], len(self._told)
            self._learn(points, np.where(np.isfinite(values), values, np.inf), slopes)

    def history(self) -> dict[str, np.ndarray]:
        """What was told, as it was told: z [M, P], losses [M] and, where `needs_gradient`, gradients [M, P]."""
        nothing = (self.start[None][:0], np.zeros(0), np.zeros((0, self._slopes)))
        z, losses, gradients = (np.concatenate(rows) for rows in zip(nothing, *self._told, strict=True))
        return {"z": z, "losses": losses, **({"gradients": gradients} if self.needs_gradient else {})}

    @property
    def _pending(self) -> int:
        """The points of this generation that have been told."""
        return sum(len(z) for z, *_ in self._told[self._begun :])

    @property
    def _slopes(self) -> int:
        return self.start.size if self.needs_gradient else 0

    def _checked(self, gradients: Numbers | None, z: np.ndarray) -> np.ndarray:
        """Gradients as they are kept: [n, P], or [n, 0] of a search that needs none."""
        if (gradients is not None) != self.needs_gradient:
            raise TuningError(
                f"{type(self).__name__} takes {'losses and gradients' if self.needs_gradient else 'losses'}"
            )
        if gradients is None:
            return np.zeros((len(z), 0))
        slopes = np.array(gradients, np.float64)
        if slopes.shape != z.shape:
            raise TuningError(f"gradients have shape {slopes.shape}, their points {z.shape}: give one for each")
        for row, parameter in np.argwhere(~np.isfinite(slopes)):
            raise GradientError(restart=self._pending + int(row), parameter=int(parameter))
        return slopes

    def _record(self, z: np.ndarray, losses: np.ndarray, gradients: np.ndarray) -> None:
        self._told.append((z, losses, gradients))
        finite = np.isfinite(losses)
        self.evaluations, self.failed = self.evaluations + len(z), self.failed + int((~finite).sum())
        least = int(np.argmin(np.where(finite, losses, np.inf)))
        if finite[least] and losses[least] < self.best.loss:
            self.best = Incumbent(float(losses[least]), z[least].copy())


Kind = TypeVar("Kind", bound=Optimiser)


def replayed(optimiser: Kind, history: Mapping[str, np.ndarray]) -> Kind:
    """The optimiser, having been told a history: it goes on as the one did that the history is of.

    Args: optimiser, made anew with the same settings and seed; history, as `Optimiser.history()` gives it. Raises
    TuningError for one that has been told something already, and where it asks for other points than the history has.
    """
    if optimiser.evaluations:
        raise TuningError(
            f"this optimiser has been told {optimiser.evaluations} losses: replay a history with a new one"
        )
    names = ["z", "losses", *(["gradients"] if optimiser.needs_gradient else [])]
    if missing := set(names).difference(history):
        raise TuningError(
            f"the history lacks {', '.join(sorted(missing))}: is it that of a {type(optimiser).__name__}?"
        )
    if len({len(history[name]) for name in names}) > 1:
        raise TuningError("the history has arrays of different lengths: it is cut off, begin anew")
    while optimiser.evaluations < len(history["z"]):
        asked, first = optimiser.ask(), optimiser.evaluations
        rows = {name: history[name][first : first + len(asked)] for name in names}
        z = np.ascontiguousarray(rows.pop("z"), np.float64)
        if not _same_bits(z, asked[: len(z)]):
            raise TuningError(
                f"the history is not of these settings, this seed and these versions: from evaluation {first} on it "
                "has other points; give the settings of then, or begin anew"
            )
        optimiser.tell(z, **rows)
    return optimiser


def _same_bits(one: np.ndarray, other: np.ndarray) -> bool:
    return one.shape == other.shape and one.tobytes() == other.tobytes()
