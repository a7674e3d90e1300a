"""The figures of the search for failures."""

from pathlib import Path
from typing import Any

import numpy as np

from experiments.tune.adversary.study import Quarry
from urbanjax.evaluation import statistics
from urbanjax.io.figures.style import BAD, GOOD, OTHER, figure
from urbanjax.tuning.adversary import Hunt, distinct
from urbanjax.tuning.adversary.hunt import SEARCHES

COLOURS = dict(zip(SEARCHES, (GOOD, "#8a5fb0", OTHER, "#2f6db3"), strict=True))
LABELS = {
    "gradient": "kriging, with gradients",
    "values": "kriging, values alone",
    "random": "random search",
    "cma_es": "CMA-ES",
}
TICKS = 33  # along the budget


def draw_counts(quarries: list[Quarry], path: Path, *, budget: float) -> None:
    """Distinct avoidable failures over rollouts, means over seeds with 95 % intervals; a panel a driver and family.

    Args: quarries; path of the picture; budget, of each search.
    """
    columns = _columns(quarries)
    rows = -(-len(quarries) // columns)
    with figure(path, 3.4 * columns, height=2.9 * rows) as canvas:
        panels = np.ravel(canvas.subplots(rows, columns, squeeze=False))
        at = np.linspace(0, budget, TICKS)
        for axes, one in zip(panels, quarries, strict=False):
            for search, colour in COLOURS.items():
                counts = np.array([_over(one, found, at) for found in one.of(search)])
                ends = [statistics.mean(column) for column in counts.T]
                axes.plot(at, counts.mean(0), color=colour, label=LABELS[search])
                axes.fill_between(at, [x.low for x in ends], [x.high for x in ends], color=colour, alpha=0.18, lw=0)
            axes.set(title=f"{one.driver}: {one.family.replace('_', ' ')}", xlabel="rollouts", ylim=(0, None))
        panels[0].set(ylabel="distinct avoidable failures")
        panels[0].legend(loc="upper left")
        for axes in panels[len(quarries) :]:
            axes.set_axis_off()


def _columns(quarries: list[Quarry]) -> int:
    """A row for each driver."""
    return max(1, len({one.family for one in quarries}))


def _over(one: Quarry, found: Hunt, at: np.ndarray) -> np.ndarray:
    costs = [trial.cost for trial in distinct(one.arena, found.failures)]
    return np.searchsorted(np.sort(costs), at, side="right")


def draw_plane(quarries: list[Quarry], path: Path) -> None:
    """What was tried in the plane of two numbers of each family: avoidable, none; rings, gradients taken.

    Args: quarries; path of the picture.
    """
    columns = _columns(quarries)
    rows = -(-len(quarries) // columns)
    with figure(path, 3.4 * columns, height=3.1 * rows) as canvas:
        panels = np.ravel(canvas.subplots(rows, columns, squeeze=False))
        for axes, one in zip(panels, quarries, strict=False):
            _plane(axes, one)
        canvas.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, markerscale=1.5)
        for axes in panels[len(quarries) :]:
            axes.set_axis_off()


def _plane(axes: Any, one: Quarry) -> None:
    keys, units = one.arena.family.plane, {n.key: n.unit for n in one.arena.space.numbers}
    trials = [trial for found in one.hunts for trial in found.trials]
    places = np.array([[one.arena.numbers(trial.z)[key] for key in keys] for trial in trials])
    failed, avoidable = (np.array([getattr(trial, name) for trial in trials]) for name in ("failed", "avoidable"))
    for which, colour, size, label in (
        (~failed, "#d5d5d5", 3, "no failure"),
        (failed & ~avoidable, "#e0a030", 12, "unavoidable"),
        (avoidable, BAD, 9, "avoidable failure"),
    ):
        axes.plot(*places[which].T, "o", ms=np.sqrt(size), color=colour, label=label, ls="none", mew=0, zorder=3)
    sloped = np.array([trial.sloped for trial in trials])
    axes.plot(*places[sloped].T, "o", ms=5, mfc="none", mec=GOOD, mew=0.8, label="with its gradient", zorder=4)
    axes.set(title=f"{one.driver}: {one.family.replace('_', ' ')}")
    axes.set(
        **{f"{end}label": f"{key.replace('_', ' ')} {_unit(units[key])}" for end, key in zip("xy", keys, strict=True)}
    )


def _unit(unit: str) -> str:
    return f"[{unit}]" if unit and "[" not in unit else unit if unit else "[share]"
