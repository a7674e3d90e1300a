"""TPE: the black-box baseline that most tuning of hyper-parameters uses."""

import contextlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from urbanjax.tuning.libraries import library
from urbanjax.tuning.optimiser import Numbers, Optimiser
from urbanjax.types.errors import TuningError

REACH = 3.0  # sigmas: of a normal distribution 99.7 % lie within


class Tpe(Optimiser):
    """Tree-structured Parzen estimator (Bergstra 2011, as in `optuna`), one point at a time.

    It needs bounds: the start +- 3 sigma, beyond which it cannot look. Its densities are multivariate (Falkner 2018),
    which is what `optuna` takes for a single loss: weights of one cost trade off, and a product of univariate ones does
    not see that. The first point is the start. The study is kept in memory.
    """

    compares_generations = True

    def __init__(self, start: Numbers, *, sigma: float, seed: int, startup: int = 10) -> None:
        """See `Optimiser`.

        Args: start [P], sigma and seed, of `Optimiser`; startup, points drawn uniformly before densities are fitted,
        the start among them. Raises TuningError for a negative one.
        """
        super().__init__(start, sigma=sigma, seed=seed)
        if startup < 0:
            raise TuningError(f"startup is {startup}: give a number of points, at least 0")
        self._library = library("optuna")
        low, high = self.start - REACH * self.sigma, self.start + REACH * self.sigma
        ranges = [self._library.distributions.FloatDistribution(*ends) for ends in np.stack([low, high], 1).tolist()]
        self._ranges = {f"z{number}": distribution for number, distribution in enumerate(ranges)}
        sampler = self._library.samplers.TPESampler(seed=seed, n_startup_trials=startup)
        with _quiet(self._library):
            self._study = self._library.create_study(sampler=sampler)
        self._study.enqueue_trial(dict(zip(self._ranges, self.start.tolist(), strict=True)))

    def _propose(self) -> np.ndarray:
        self._trial = self._study.ask(self._ranges)
        return np.array([[self._trial.params[name] for name in self._ranges]])

    def _learn(self, z: np.ndarray, losses: np.ndarray, gradients: np.ndarray) -> None:
        with _quiet(self._library):
            self._study.tell(self._trial, float(losses[0]))


@contextlib.contextmanager
def _quiet(optuna: Any) -> Iterator[None]:
    """Without its lines on every trial; the level of whoever else uses the library stays."""
    before = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        yield
    finally:
        optuna.logging.set_verbosity(before)
