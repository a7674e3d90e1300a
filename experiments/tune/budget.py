"""The same problem, the same budget: descent along gradients beside the searches that need none."""

import dataclasses
import time
from pathlib import Path
from typing import Any

import numpy as np

from experiments.tune.study import BudgetParams, TuneStudy
from urbanjax.evaluation import statistics
from urbanjax.io.figures.style import BAD, GOOD, OTHER, figure
from urbanjax.io.runs import progress, report
from urbanjax.io.runs.checkpoints import read_checkpoint, write_checkpoint
from urbanjax.io.runs.directory import Run, digest
from urbanjax.io.runs.sweeps.code import code_digest
from urbanjax.tuning import Training, space
from urbanjax.tuning.starts import scene_set
from urbanjax.types import ConfigError, as_arrays, host_record

COLOURS = {"gradient": GOOD, "cma_es": BAD, "tpe": "#2c6fbb", "random": OTHER}
NAMES = {"gradient": "gradient (Adam)", "cma_es": "CMA-ES", "tpe": "TPE", "random": "random search"}
FOLDER = "searches"
SHOWN = 6  # restarts drawn
LEAST = 0.1  # of the score, that a picture goes below where searches begin; they may fall farther
CAPTION = (
    "An evaluation is {scenes} scenes of {horizon:g} s; a gradient counts as the {multiple:.2f} evaluations that it "
    "costs, measured here. All searches draw their scenes from the same {pool}: others in each generation, but TPE and "
    "random search, which compare all their points, once. They have the same start, spread, bounds and transforms, and "
    "begin off the defaults, by {detuned:g} N(0, 1) in z. Scores are of {fresh} scenes that none of them has seen, as "
    "deployed, of the point that the search stands by; dotted, what the better of CMA-ES and TPE stands by in the end. "
    "Brackets: 95 % bootstrap over {restarts} restarts, each with scenes, start and seed of its own; of medians, "
    "between order statistics"
)


@host_record
class BudgetCurve:
    """One search: what it stood by, and when."""

    optimiser: str
    restart: int
    cost: np.ndarray  # [C] evaluations without gradient, at each look
    seconds: np.ndarray  # [C] s, without the looks themselves and without compiling
    score: np.ndarray  # [C] of fresh scenes


def write(params: TuneStudy, run: Run) -> None:
    """Run all searches, and write table, figure and report; every search is kept as it ends."""
    budget = params.budget
    curves, multiple = _curves(params, run)
    table = _table(curves, budget)
    progress.show_table("budget", table)
    run.table("budget", table)
    rows: dict[str, list[Any]] = {name: [] for name in ("optimiser", "restart", "cost", "seconds", "score")}
    for one in curves:
        for cost, seconds, score in zip(one.cost, one.seconds, one.score, strict=True):
            for name, value in zip(rows, (one.optimiser, one.restart, cost, seconds, score), strict=True):
                rows[name].append(value)
    run.table("curves", rows)
    run.summary({"cost_of_gradient": multiple, **_summary(curves, budget)})
    draw(curves, run.path("budget.png"))
    told = CAPTION.format(
        scenes=params.training.scenes,
        horizon=float(params.training.horizons[-1]),
        multiple=multiple,
        pool=params.learned.count,
        detuned=float(budget.detuned),
        fresh=params.judged.count,
        restarts=budget.restarts,
    )
    items = [
        report.Picture("Score of fresh scenes over cost and over seconds", run.path("budget.png")),
        report.Table(told, table),
    ]
    report.write_report(
        run.path("report.html"),
        "Searches at equal cost",
        sections=[report.Section("The same problem, the same budget", [], items)],
        manifest=run.manifest("complete"),
    )


def reached(one: BudgetCurve, score: float) -> tuple[float, float]:
    """Cost and seconds at which a search first stood by that score; infinite where it never did."""
    there = np.flatnonzero(one.score >= score)
    return (float(one.cost[there[0]]), float(one.seconds[there[0]])) if there.size else (np.inf, np.inf)


def _curves(params: TuneStudy, run: Run) -> tuple[list[BudgetCurve], float]:
    """All searches, those that a run to resume has done already as they are there, and the cost of a gradient."""
    kept = {name: value for name, value in run.resolved.items() if name != "resume"}
    stamp = {"config": digest(kept), "code": code_digest()}
    run.path(FOLDER).mkdir(exist_ok=True)
    found, multiple = [], 0.0
    with progress.bar("budget") as tick:
        for restart in range(params.budget.restarts):
            problem = None
            for number, optimiser in enumerate(params.budget.optimisers):
                name = f"{optimiser}-{restart}.safetensors"
                share = (restart * len(params.budget.optimisers) + number) / (
                    params.budget.restarts * len(params.budget.optimisers)
                )
                tick(f"{optimiser}, restart {restart}", share)
                arrays = _known(params.resume, name, stamp)
                if arrays is None:
                    problem = problem or _problem(params, restart)
                    multiple = multiple or _cost_of_gradient(params, restart, problem)
                    arrays = _searched(params, optimiser, restart, problem, multiple)
                multiple = float(arrays["multiple"])
                write_checkpoint(run.path(FOLDER) / name, arrays, about=stamp)
                found.append(BudgetCurve(optimiser, restart, *(arrays[key] for key in ("cost", "seconds", "score"))))
    return found, multiple


def _known(resume: str, name: str, stamp: dict[str, str]) -> dict[str, np.ndarray] | None:
    if not resume:
        return None
    folder = Path(resume) / FOLDER
    if not folder.is_dir():
        raise ConfigError(f"resume={resume}: there is no {FOLDER} in it; name the directory of a budget run")
    if not (folder / name).is_file():
        return None
    arrays, about = read_checkpoint(folder / name)
    for key, value in stamp.items():
        if about.get(key) != value:
            raise ConfigError(f"resume={resume}: that run was of another {key}; begin anew")
    return arrays


def _problem(params: TuneStudy, restart: int) -> Any:
    """A restart: where all its searches begin, the scenes that they learn from, and fresh ones."""
    seed, base = params.training.seed + 1000 * restart, as_arrays(params.loop())
    size, horizon = space(base, params.tuned).size, float(params.training.horizons[-1])
    scenes = (
        scene_set(base, which, horizon=horizon, seed=seed + number)
        for number, which in enumerate((params.learned, params.judged))
    )
    return float(params.budget.detuned) * np.random.default_rng(seed).normal(size=size), *scenes


def _training(params: TuneStudy, optimiser: str, restart: int, problem: Any, generations: int) -> Training:
    settings = dataclasses.replace(
        params.training,
        optimiser=optimiser,
        seed=params.training.seed + restart,
        generations=generations,
        horizons=params.training.horizons[-1:],
        every=10**6,
    )
    tuned, (start, learned, judged) = space(as_arrays(params.loop()), params.tuned), problem
    return Training(tuned, settings, learned=learned, judged=judged, scores=params.score, start=start)


def _cost_of_gradient(params: TuneStudy, restart: int, problem: Any) -> float:
    return _training(params, "gradient", restart, problem, 1).cost_of_gradient(5)


def _searched(params: TuneStudy, optimiser: str, restart: int, problem: Any, multiple: float) -> dict[str, np.ndarray]:
    """One search within its budget: cost, seconds and score of fresh scenes at every look."""
    budget = params.budget
    cost = multiple if optimiser == "gradient" else 1.0
    most = int(float(budget.evaluations) / cost + 1e-9)
    search = _training(params, optimiser, restart, problem, most)
    looks: list[tuple[float, float, float]] = []
    spent = 0.0
    while True:
        looks.append((search.optimiser.evaluations * cost, spent, -search.look().mean()))
        if search.optimiser.evaluations >= most:
            break
        until = looks[-1][0] + float(budget.apart)
        while search.optimiser.evaluations * cost < until and search.optimiser.evaluations < most:
            began = time.perf_counter()
            search.learn()
            spent += time.perf_counter() - began
    columns = np.array(looks).T
    return {"cost": columns[0], "seconds": columns[1], "score": columns[2], "multiple": np.array(multiple)}


def _goal(curves: list[BudgetCurve], restart: int) -> float:
    """What the better of the searches without gradient, but the random one, stood by in the end."""
    rivals = [one for one in curves if one.restart == restart and one.optimiser in ("cma_es", "tpe")]
    return max((float(one.score[-1]) for one in rivals), default=np.nan)


def _table(curves: list[BudgetCurve], budget: BudgetParams) -> dict[str, list[Any]]:
    out: dict[str, list[Any]] = {}
    for name in budget.optimisers:
        part = [one for one in curves if one.optimiser == name]
        cost, seconds = np.array([reached(one, _goal(curves, one.restart)) for one in part]).T
        line = {
            "search": NAMES[name],
            "restarts": len(part),
            "score before": statistics.mean([one.score[0] for one in part]).text(3),
            "score in the end": statistics.mean([one.score[-1] for one in part]).text(3),
            "time in all [s] (median)": statistics.median([one.seconds[-1] for one in part]).text(0),
            "as good as the better of CMA-ES and TPE": f"{int(np.isfinite(cost).sum())} of {len(part)}",
            "at a cost of (median)": statistics.median(cost).text(0),
            "after [s] (median)": statistics.median(seconds).text(0),
        }
        for key, value in line.items():
            out.setdefault(key, []).append(value)
    return out


def _summary(curves: list[BudgetCurve], budget: BudgetParams) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for name in budget.optimisers:
        part = [one for one in curves if one.optimiser == name]
        out |= statistics.mean([one.score[-1] for one in part]).flat(f"{name}_last_score")
        cost, seconds = np.array([reached(one, _goal(curves, one.restart)) for one in part]).T
        out |= statistics.median(cost).flat(f"{name}_cost_evaluations")
        out |= statistics.median(seconds).flat(f"{name}_cost_s")
    return out


def draw(curves: list[BudgetCurve], path: Path) -> None:
    """Scores of each restart's searches over cost and over seconds. Args: curves; path of the picture."""
    restarts = sorted({one.restart for one in curves})[:SHOWN]
    axis = {"cost": "cost [evaluations without gradient]", "seconds": "time [s], warm"}
    with figure(path, 2.4 * len(restarts) + 1.4, height=4.6) as canvas:
        panels = canvas.subplots(len(axis), len(restarts), sharey="col", squeeze=False)
        for restart, column in zip(restarts, panels.T, strict=True):
            part = [one for one in curves if one.restart == restart]
            for axes, name in zip(column, axis, strict=True):
                for one in part:
                    axes.plot(getattr(one, name), one.score, color=COLOURS[one.optimiser], label=NAMES[one.optimiser])
                axes.axhline(_goal(curves, restart), color="k", lw=0.6, ls=":")
                axes.set(xlim=(0, None))
            start, best = part[0].score[0], max(one.score.max() for one in part)
            span = max(best - start, LEAST)
            column[0].set(ylim=(start - span, best + 0.1 * span))
            column[0].set_title(f"restart {restart}")
        for row, label in zip(panels, axis.values(), strict=True):
            row[len(row) // 2].set_xlabel(label)
            row[0].set_ylabel("score of fresh scenes")
        panels[0, 0].legend(loc="lower right")
