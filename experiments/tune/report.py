"""The report of the task that is asked."""

from collections.abc import Callable

from experiments.tune import budget, closed_loop, horizons, pareto
from experiments.tune.adversary import report as adversary
from experiments.tune.imitation import report as imitation
from experiments.tune.study import TuneStudy
from urbanjax.io.runs.directory import Run

WRITERS: dict[str, Callable[[TuneStudy, Run], None]] = {
    "closed_loop": closed_loop.write,
    "pareto": pareto.write,
    "budget": budget.write,
    "horizons": horizons.write,
    "imitation": imitation.write,
    "lattice": imitation.write_lattice,
    "adversary": adversary.write,
}


def write(params: TuneStudy, run: Run) -> None:
    """Run the task and write its report."""
    WRITERS[params.task](params, run)
