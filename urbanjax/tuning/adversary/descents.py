"""Descents that begin where a look around found most threat, and anew elsewhere once they have found a failure."""

import numpy as np

from urbanjax.tuning.optimiser import Numbers, Optimiser
from urbanjax.types.errors import TuningError

BEFOREHAND = (0.1, 1.0)  # failures found and cost, that either way of going on is credited with at first
PROGRESS = 0.05  # of the loss, that a step has to bring
PATIENCE = 2  # steps without
LEAST = 1e-9  # of the norm of a gradient


class Descents(Optimiser):
    """Normalised gradient descent from the most threatening of points drawn around the start, again and again.

    A look around costs no gradients, so a generation needs them or not: see `needs_gradient`. A descent ends where it
    has found a failure, where it goes on no more (for two steps), and after `steps`. When all have ended there
    is another look around; where failures are so common that looking finds more of them for its cost than descending
    has, there is no descent after it. Step lengths fall from `rate` to a third of it.
    """

    def __init__(
        self,
        start: Numbers,
        *,
        sigma: float,
        seed: int,
        population: int = 16,
        restarts: int = 4,
        rate: float = 0.8,
        steps: int = 8,
        found: float = -5.0,
        cost_of_gradient: float = 1.0,
    ) -> None:
        """See `Optimiser`.

        Args: start [P], sigma and seed, of `Optimiser`; population, points of a look around; restarts, of them, that
        descend; rate, the first step, in units of z; steps, of a descent; found, a loss below which a failure is found;
        cost_of_gradient, of a loss with it, in losses. Raises TuningError for restarts that are not so many points.
        """
        super().__init__(start, sigma=sigma, seed=seed)
        if not 1 <= restarts <= population or not 0 < rate < np.inf or steps < 1:
            raise TuningError(
                f"restarts is {restarts}, population {population}, rate {rate}, steps {steps}: give positive numbers, "
                "and no more restarts than points"
            )
        self._rng, self._population, self._restarts = np.random.default_rng(seed), population, restarts
        self._rate, self._steps, self._found, self._price = rate, steps, found, cost_of_gradient
        self.needs_gradient = False  # type: ignore[misc]  # of the generation that is asked for
        self._yield = {False: list(BEFOREHAND), True: list(BEFOREHAND)}  # of looking, and of descending
        self._points, self._since = self.start[None][:0], np.zeros(0, int)
        self._least, self._age = np.zeros(0), 0

    @property
    def _slopes(self) -> int:
        return self.start.size

    def _checked(self, gradients: Numbers | None, z: np.ndarray) -> np.ndarray:
        slopes = super()._checked(gradients, z)
        return slopes if self.needs_gradient else np.zeros_like(z)

    def _propose(self) -> np.ndarray:
        if self.needs_gradient:
            return self._points
        drawn = self.start + self.sigma * self._rng.normal(size=(self._population, self.start.size))
        return drawn if self.evaluations else np.concatenate([self.start[None], drawn[1:]])

    def _learn(self, z: np.ndarray, losses: np.ndarray, gradients: np.ndarray) -> None:
        found = losses < self._found
        price = self._price if self.needs_gradient else 1.0
        tally = self._yield[self.needs_gradient]
        tally[0], tally[1] = tally[0] + found.sum(), tally[1] + price * len(z)
        if self.needs_gradient:
            self._descend(z, losses, gradients)
        else:
            self._begin(z, losses)

    def _begin(self, z: np.ndarray, losses: np.ndarray) -> None:
        """Descents from the most threatening points that are no failures already, if that is worth while."""
        looking, descending = (found / cost for found, cost in self._yield.values())
        order = [k for k in np.argsort(losses) if losses[k] >= self._found and np.isfinite(losses[k])]
        if descending < looking or not order:
            return
        chosen = order[: self._restarts]
        self._points, self._least = z[chosen], np.full(len(chosen), np.inf)
        self._since, self._age = np.zeros(len(chosen), int), 0
        self.needs_gradient = True  # type: ignore[misc]

    def _descend(self, z: np.ndarray, losses: np.ndarray, gradients: np.ndarray) -> None:
        """One step of those that go on."""
        better = losses < self._least - PROGRESS
        self._since = np.where(better, 0, self._since + 1)
        self._least = np.minimum(self._least, losses)
        self._age += 1
        norms = np.linalg.norm(gradients, axis=1, keepdims=True)
        length = self._rate * (1 - 2 / 3 * (self._age - 1) / self._steps)
        goes_on = (losses >= self._found) & (self._since < PATIENCE) & (norms[:, 0] > LEAST)
        goes_on &= self._age < self._steps
        moved = z - length * gradients / np.maximum(norms, LEAST)
        self._points, self._least, self._since = moved[goes_on], self._least[goes_on], self._since[goes_on]
        self.needs_gradient = bool(goes_on.any())  # type: ignore[misc]
