"""A search for many different failures: drives where a model of values and slopes expects one that is not known yet."""

from collections.abc import Callable

import numpy as np
from scipy.special import ndtr

from urbanjax.tuning.adversary.kriging import Kriging, Observed, krige
from urbanjax.tuning.optimiser import Numbers, Optimiser
from urbanjax.types.errors import TuningError

SCALE = 10.0  # of a loss, beyond which it is far from anything
CANDIDATES = 1000  # among which a generation is chosen
SURE = 0.3  # of a generation that found: no slopes are asked for after it


class KrigedSearch(Optimiser):
    """Probes first; then points that a kriging of losses and slopes takes for the likeliest finds in cells without one.

    A cell that holds a find, or another point of the generation, is passed over, so that neighbours of a find are tried
    next, along the boundary of where failures are. Slopes cost more: they are asked for a few points only, after a
    generation that found little, and as long as they agree with values; see `needs_gradient`. Every loss comes with its
    slopes where those are asked for, so nothing is driven twice. Slopes that are not finite are left out.
    """

    def __init__(
        self,
        start: Numbers,
        *,
        sigma: float,
        seed: int,
        cells: Callable[[np.ndarray], np.ndarray],
        found: float,
        population: int = 16,
        sloped: int = 6,
    ) -> None:
        """See `Optimiser`.

        Args: start [P], sigma and seed, of `Optimiser`; cells, takes points [N, P] to cells [N, P] of integers; found,
        a loss below which a point is a find; population, points of a generation; sloped, of one with slopes, 0 for a
        search without any. Raises TuningError where these are no such numbers.
        """
        super().__init__(start, sigma=sigma, seed=seed)
        if population < 1 or sloped < 0:
            raise TuningError(f"population is {population}, sloped {sloped}: give a positive one, and none below zero")
        self._rng, self._population, self._sloped = np.random.default_rng(seed), population, sloped
        self._cells, self._found = cells, found
        self.needs_gradient = False  # type: ignore[misc]  # of the generation that is asked for
        nothing = self.start[None][:0]
        self._seen = Observed(nothing, np.zeros(0), nothing, np.zeros(0, int))
        self._trusts = True  # slopes
        self._known: set[tuple[int, ...]] = set()

    @property
    def _slopes(self) -> int:
        return self.start.size

    def _checked(self, gradients: Numbers | None, z: np.ndarray) -> np.ndarray:
        if gradients is not None:  # a point whose slopes are not finite has a value still: zeros stand for none
            known = np.isfinite(gradients).all(axis=-1, keepdims=True)
            gradients = np.where(known, gradients, 0.0)
        slopes = super()._checked(gradients, z)
        return slopes if self.needs_gradient else np.zeros_like(z)

    def _propose(self) -> np.ndarray:
        if not self.evaluations:
            drawn = self.start + self.sigma * self._rng.normal(size=(self._population, self.start.size))
            drawn[0] = self.start
            return drawn
        drawn = self.start + self.sigma * self._rng.normal(size=(CANDIDATES, self.start.size))
        model = krige(self._seen)
        self._trusts = model.trusts
        order = np.argsort(-self._promise(model, drawn), kind="stable")
        return drawn[self._apart(drawn[order], order)]

    def _promise(self, model: Kriging, z: np.ndarray) -> np.ndarray:
        """How likely each point [N] is a find."""
        mean, deviation = model.at(_bounded(z))
        return ndtr((SCALE * np.tanh(self._found / SCALE) - mean) / deviation)

    def _apart(self, z: np.ndarray, order: np.ndarray) -> list[int]:
        """The first of these, one of each cell without a find."""
        count, taken, chosen = self._sloped if self.needs_gradient else self._population, set(self._known), []
        for index, cell in zip(order, map(tuple, self._cells(z)), strict=True):
            if cell not in taken:
                chosen.append(int(index))
                taken.add(cell)
            if len(chosen) == count:
                return chosen
        return chosen or [int(order[0])]  # where every cell has one there is nothing left to find

    def _learn(self, z: np.ndarray, losses: np.ndarray, gradients: np.ndarray) -> None:
        finds = losses < self._found
        self._known |= set(map(tuple, self._cells(z[finds]))) if finds.any() else set()
        finite = np.isfinite(losses)
        values, x = SCALE * np.tanh(losses / SCALE), _bounded(z)  # infinite ones are as far as can be
        seen, slopes, which = self._seen, self._seen.slopes, self._seen.sloped
        if self.needs_gradient:
            steep = gradients * (1 - (values / SCALE) ** 2)[:, None] * 2 / (1 - x**2)
            with_slopes = np.flatnonzero(
                finite & ~finds & gradients.any(axis=1)
            )  # there a find's loss is cut off from what leads to it
            slopes, which = (
                np.concatenate([slopes, steep[with_slopes]]),
                np.append(which, len(seen.values) + with_slopes),
            )
        self._seen = Observed(np.concatenate([seen.points, x]), np.append(seen.values, values), slopes, which)
        doubts = finds.mean() < SURE
        wanted = self._sloped and doubts and self._trusts
        self.needs_gradient = bool(wanted and not self.needs_gradient)  # type: ignore[misc]


def _bounded(z: np.ndarray) -> np.ndarray:
    """Coordinates between -1 and 1, [N, P]: as shares of a range whose middle is z = 0."""
    return np.clip(np.tanh(z / 2), -0.999, 0.999)
