"""A search within a budget, one generation after the other."""

import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from urbanjax.tuning.optimiser import Optimiser
from urbanjax.types import host_record
from urbanjax.types.errors import TuningError


@host_record
class Generation:
    """Where a search stands after a generation."""

    evaluations: int  # points evaluated so far
    cost: float  # of them, in evaluations without gradient
    failed: int  # of them, with a loss that is not finite
    best_loss: float
    best_z: np.ndarray  # [P]
    seconds: float  # s, since this part of the search began, evaluations included


def minimise(
    evaluate: Callable[[np.ndarray], Any],
    optimiser: Optimiser,
    *,
    budget: float | int,
    cost_of_gradient: float | int | None = None,
) -> Iterator[Generation]:
    """Every generation of a search, as it is done; its last one is cut to the budget.

    Whoever takes them may write each, and stop. An optimiser that has been told something goes on within what its
    budget leaves.
    Args: evaluate, the losses [N] of points z [N, P], and their gradients [N, P] where the optimiser needs them; seeds
    that the points of a generation share are its own; optimiser, of any kind; budget, of the whole search, in
    evaluations without gradient; cost_of_gradient, how many of these a loss with its gradient costs, as measured: of no
    account to an optimiser that needs none. Raises TuningError for a budget that buys nothing, a cost that is not
    stated, and what `Optimiser.tell` refuses.
    """
    cost = _cost(optimiser, cost_of_gradient)
    if not cost <= budget < math.inf:
        raise TuningError(f"a budget of {budget} buys no evaluation of cost {cost}: give more of it, and finite")
    affordable = math.floor(budget / cost * (1 + 1e-12))  # 3.3 / 1.1 is three, whatever the last bit says
    return _generations(evaluate, optimiser, affordable=affordable, cost=cost)


def _cost(optimiser: Optimiser, cost_of_gradient: float | int | None) -> float:
    if not optimiser.needs_gradient:
        return 1.0
    if cost_of_gradient is None or not 0 < cost_of_gradient < math.inf:
        raise TuningError(
            f"cost_of_gradient is {cost_of_gradient}: measure how many evaluations a loss with its gradient costs, for "
            f"{type(optimiser).__name__} needs both"
        )
    return float(cost_of_gradient)


def _generations(
    evaluate: Callable[[np.ndarray], Any], optimiser: Optimiser, *, affordable: int, cost: float
) -> Iterator[Generation]:
    began = time.perf_counter()
    while (left := affordable - optimiser.evaluations) > 0:
        z = optimiser.ask()[:left]
        found = evaluate(z)
        if isinstance(found, tuple) != optimiser.needs_gradient:
            wanted = "(losses, gradients)" if optimiser.needs_gradient else "losses alone"
            raise TuningError(f"evaluate gave a {type(found).__name__}: {type(optimiser).__name__} needs {wanted}")
        losses, gradients = found if isinstance(found, tuple) else (found, None)
        optimiser.tell(z, losses, gradients=gradients)
        yield Generation(
            evaluations=optimiser.evaluations,
            cost=optimiser.evaluations * cost,
            failed=optimiser.failed,
            best_loss=optimiser.best.loss,
            best_z=optimiser.best.z,
            seconds=time.perf_counter() - began,
        )
