"""Random search: what any other has to beat."""

import numpy as np

from urbanjax.tuning.optimiser import Numbers, Optimiser
from urbanjax.types.errors import TuningError


class RandomSearch(Optimiser):
    """Points drawn from a normal distribution around the start; it learns nothing. The first is the start itself."""

    compares_generations = True

    def __init__(self, start: Numbers, *, sigma: float, seed: int, population: int = 16) -> None:
        """See `Optimiser`. Args: start [P], sigma and seed, of `Optimiser`; population, points of a generation."""
        super().__init__(start, sigma=sigma, seed=seed)
        if population < 1:
            raise TuningError(f"population is {population}: give a number of points, at least 1")
        self._population, self._rng = population, np.random.default_rng(seed)

    def _propose(self) -> np.ndarray:
        drawn = self.start + self.sigma * self._rng.normal(size=(self._population, self.start.size))
        return drawn if self.evaluations else np.concatenate([self.start[None], drawn[1:]])

    def _learn(self, z: np.ndarray, losses: np.ndarray, gradients: np.ndarray) -> None:
        """Of what it is told, nothing: the next points are drawn as the first ones."""
