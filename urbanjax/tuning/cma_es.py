"""CMA-ES with restarts: the strong black-box baseline in tens of dimensions."""

import math
from typing import Any

import numpy as np

from urbanjax.tuning.libraries import library
from urbanjax.tuning.optimiser import SEEDS, Numbers, Optimiser
from urbanjax.types.errors import TuningError

LARGEST = 1e300  # of a loss: differences of two are finite


class CmaEs(Optimiser):
    """Covariance matrix adaptation (Hansen 2016, as in `cmaes`), restarted with twice the points (IPOP, Auger 2005).

    The first run begins at the start. IPOP draws where another begins uniformly within bounds; z has none, so it begins
    at the start + sigma * normal: within the spread that the search was given. A run ends by the criteria of `cmaes`
    (flat, converged, diverging or ill-conditioned), and what it has cost is part of the search's.
    """

    def __init__(self, start: Numbers, *, sigma: float, seed: int, population: int | None = None) -> None:
        """See `Optimiser`.

        Args: start [P], sigma and seed, of `Optimiser`; population, points of a generation of the first run (default:
        4 + 3 log P). Raises TuningError for fewer than that, with which the covariance is not learned reliably.
        """
        super().__init__(start, sigma=sigma, seed=seed)
        least = 4 + math.floor(3 * math.log(self.start.size))
        if population is not None and population < least:
            raise TuningError(
                f"population is {population}: give at least {least} points for {self.start.size} parameters"
            )
        self._library, self._rng = library("cmaes"), np.random.default_rng(seed)
        self.restarts, self._worst = 0, 0.0
        self._run = self._begun_at(self.start, population or least)

    def _begun_at(self, mean: np.ndarray, population: int) -> Any:
        seed = int(self._rng.integers(SEEDS))
        return self._library.CMA(mean=mean, sigma=self.sigma, seed=seed, population_size=population)

    def standing(self) -> np.ndarray:
        """The mean [1, P] of the distribution, which is less a matter of luck than the best point that it drew."""
        return np.array(self._run.mean, np.float64)[None]

    def _propose(self) -> np.ndarray:
        return np.stack([self._run.ask() for _ in range(self._run.population_size)])

    def _learn(self, z: np.ndarray, losses: np.ndarray, gradients: np.ndarray) -> None:
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # of a run that ends for being degenerate
            self._run.tell(list(zip(z, self._ranked(losses), strict=True)))
            ended = self._run.should_stop()
        if ended:
            self.restarts += 1
            mean = self.start + self.sigma * self._rng.normal(size=self.start.size)
            self._run = self._begun_at(mean, 2 * self._run.population_size)

    def _ranked(self, losses: np.ndarray) -> list[float]:
        """Finite losses of the same order: only ranks count, but the criterion of flatness subtracts them."""
        finite = np.isfinite(losses)
        if finite.any():
            self._worst = float(np.clip(losses[finite].max(), -LARGEST, LARGEST))
        worse = self._worst + max(1.0, abs(self._worst))
        return np.where(finite, np.clip(losses, -LARGEST, LARGEST), worse).tolist()
