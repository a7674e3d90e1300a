"""A search for failures within a budget, and how many different ones it has found (host side)."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from urbanjax.tuning.adversary.arena import Arena
from urbanjax.tuning.adversary.kriged_search import KrigedSearch
from urbanjax.tuning.cma_es import CmaEs
from urbanjax.tuning.optimiser import SEEDS, Optimiser
from urbanjax.tuning.random_search import RandomSearch
from urbanjax.types import host_record

FOUND = 20.0  # m, by which the loss of an avoidable failure lies below its threat: every search is told so
SIGMA = 1.7  # of z: a logistic of that spread is nearly uniform over the range of a number
POINTS = 16  # of a generation
RENEWED = 7919  # apart are the seeds of searches that begin anew


@host_record
class Trial:
    """One point that a search has tried."""

    z: np.ndarray  # [P]
    cost: float  # of the search so far, this one included, in evaluations without gradient
    threat: float  # m
    failed: bool
    avoidable: bool
    latest: float  # s, when full braking had to begin
    sloped: bool  # whether it was asked for with its gradient
    broken: bool = False  # whether that is not finite


@host_record
class Hunt:
    """All that one search has tried."""

    search: str
    seed: int
    trials: tuple[Trial, ...]

    @property
    def failures(self) -> list[Trial]:
        """Those that braking would have avoided."""
        return [trial for trial in self.trials if trial.avoidable]

    @property
    def unavoidable(self) -> list[Trial]:
        """Collisions at fault that it would not have avoided."""
        return [trial for trial in self.trials if trial.failed and not trial.avoidable]


def by_gradient(arena: Arena, seed: int, *, cost_of_gradient: float) -> Optimiser:
    """Kriging of losses and slopes, of so many slopes at once as cost a generation.

    Args: arena; seed; cost_of_gradient, as measured.
    """
    return _kriged(arena, seed=seed, sloped=max(1, int(POINTS / cost_of_gradient)))


def by_values(arena: Arena, seed: int, *, cost_of_gradient: float) -> Optimiser:
    """The same without slopes, which tells what they are worth. Args: arena; seed; cost_of_gradient, of no account."""
    return _kriged(arena, seed=seed, sloped=0)


def by_chance(arena: Arena, seed: int, *, cost_of_gradient: float) -> Optimiser:
    """Random search. Args: arena; seed; cost_of_gradient, of no account."""
    return RandomSearch(_start(arena), sigma=SIGMA, seed=seed, population=POINTS)


def by_cma_es(arena: Arena, seed: int, *, cost_of_gradient: float) -> Optimiser:
    """CMA-ES. Args: arena; seed; cost_of_gradient, of no account."""
    return CmaEs(_start(arena), sigma=SIGMA, seed=seed, population=POINTS)


def _kriged(arena: Arena, *, seed: int, sloped: int) -> Optimiser:
    return KrigedSearch(
        _start(arena),
        sigma=SIGMA,
        seed=seed,
        cells=arena.cells,
        found=-FOUND / 2,
        population=POINTS,
        sloped=sloped,
    )


def _start(arena: Arena) -> np.ndarray:
    return np.zeros(len(arena.space.keys))


SEARCHES: dict[str, Callable[..., Optimiser]] = {
    "gradient": by_gradient,
    "values": by_values,
    "random": by_chance,
    "cma_es": by_cma_es,
}


def hunt(arena: Arena, search: str, *, seed: int, budget: float, cost_of_gradient: float) -> Hunt:
    """What a search tries within a budget; a point with its gradient costs as many evaluations as measured.

    A CMA-ES whose generation holds a failure begins anew: it would sample around that one for ever.
    Args: arena; search, in SEARCHES; seed; budget, in evaluations without gradient; cost_of_gradient.
    """
    make = SEARCHES[search]
    optimiser, cost, trials, begun = make(arena, seed, cost_of_gradient=cost_of_gradient), 0.0, [], 0
    while True:
        sloped = optimiser.needs_gradient
        price = cost_of_gradient if sloped else 1.0
        z = optimiser.ask()[: math.floor((budget - cost) / price + 1e-9)]
        if not len(z):
            return Hunt(search, seed, tuple(trials))
        seen = arena.sloped(z) if sloped else arena.judged(z)
        for k in range(len(z)):
            cost += price
            told = bool(seen.failed[k]), bool(seen.avoidable[k]), float(seen.latest[k])
            broken = seen.gradients is not None and not np.isfinite(seen.gradients[k]).all()
            trials.append(Trial(z[k], cost, float(seen.threat[k]), *told, sloped, broken))
        optimiser.tell(z, seen.threat - FOUND * seen.avoidable, gradients=seen.gradients if sloped else None)
        if search == "cma_es" and seen.avoidable.any():
            begun += 1
            optimiser = make(arena, (seed + RENEWED * begun) % SEEDS, cost_of_gradient=cost_of_gradient)


def distinct(arena: Arena, trials: Sequence[Trial]) -> list[Trial]:
    """The first failure in each cell of the space: of every number the lower, middle or upper part of its range.

    Args: arena; trials, failures.
    """
    if not trials:
        return []
    cells = arena.cells(np.stack([trial.z for trial in trials]))
    first: dict[tuple[int, ...], Trial] = {}
    for cell, trial in zip(cells, trials, strict=True):
        first.setdefault(tuple(cell), trial)
    return list(first.values())
