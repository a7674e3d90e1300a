"""A front of parameter sets between speed and comfort: one batch of searches, each with its own preference."""

import dataclasses
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from experiments.common.scenes import scenes
from experiments.tune import tested
from experiments.tune.search import Searched, searched
from experiments.tune.study import ParetoParams, TuneStudy
from experiments.tune.tested import HeldBackDrives
from urbanjax.evaluation import statistics
from urbanjax.evaluation.scores import ScoreParams
from urbanjax.evaluation.statistics import WithInterval
from urbanjax.io.figures.style import BAD, GOOD, OTHER, figure
from urbanjax.io.runs import progress, report
from urbanjax.io.runs.directory import Run
from urbanjax.io.runs.parameter_file import write_parameters
from urbanjax.io.runs.sweeps.code import code_digest
from urbanjax.rollout import LoopParams
from urbanjax.types import as_arrays, host_record, with_values

BEFORE, TAU = "before", "stack.behavior.gvp.tau"
TUNED, TAUS = "tuned, by preference", "before, other values of tau"
STYLES = {TUNED: (GOOD, "o"), TAUS: (OTHER, "^"), BEFORE: (BAD, "s")}
OBJECTIVES = {"speed": ("progress",), "comfort": ("acceleration", "lateral", "jerk", "discomfort")}
GUARDED = {"room": ("clearance", "road", "lane")}  # counts as ever, whatever is preferred
CAPTION = (
    "Terms of the score with their standard weights, of whole drives as deployed, which tuning has not seen: speed is "
    "the mean speed over 10 m/s; comfort is what is lost by accelerations and jerk, with its sign; room what is lost "
    "by nearness, the edge of the road and the offset from the lane, whose weights no preference changes. More is "
    "better in all. Front: of the tuned nobody else is as good in one of speed and comfort and better in the other; "
    "equals count once. Brackets: 95 %, whole roads drawn; of collisions: Wilson's"
)


@host_record
class FrontPoint:
    """One parameter set in both objectives, and in what was guarded meanwhile."""

    name: str
    objectives: dict[str, WithInterval]
    guarded: dict[str, WithInterval]
    gains: dict[str, WithInterval]  # in the objectives, over the parameters before, from the same starts
    at_fault: WithInterval  # share of drives with a collision at fault


def preferences(params: ParetoParams, standard: ScoreParams) -> list[tuple[float, ScoreParams]]:
    """Ratios of the weights of comfort and of speed to the standard score's, a geometric series, and their scores."""
    found = []
    for ratio in np.geomspace(float(params.least), float(params.most), params.points).tolist():
        half = ratio**0.5  # so that slopes remain of one size
        factors = {name: half for name in OBJECTIVES["comfort"]} | {name: 1 / half for name in OBJECTIVES["speed"]}
        weights = {name: factor * getattr(standard, name) for name, factor in factors.items()}
        found.append((ratio, dataclasses.replace(standard, **weights)))
    return found


def points(found: HeldBackDrives) -> list[FrontPoint]:
    """Every parameter set in both objectives. Args: found, drives of all sets."""
    first = found.rows[found.names[0]]

    def term(rows: list[dict[str, Any]], names: tuple[str, ...]) -> list[float]:
        return [sum(row[f"score_{name}"] for name in names) for row in rows]

    def of(rows: list[dict[str, Any]], terms: dict[str, tuple[str, ...]]) -> dict[str, WithInterval]:
        return {name: statistics.mean(term(rows, parts), groups=scenes(rows)) for name, parts in terms.items()}

    def gains(rows: list[dict[str, Any]]) -> dict[str, WithInterval]:
        return {
            name: statistics.paired(term(rows, parts), term(first, parts), groups=scenes(first))
            for name, parts in OBJECTIVES.items()
        }

    return [
        FrontPoint(
            name,
            of(rows, OBJECTIVES),
            of(rows, GUARDED),
            gains(rows),
            statistics.rate([row["competition_at_fault"] for row in rows]).percent,
        )
        for name, rows in found.rows.items()
    ]


def on_front(candidates: list[FrontPoint]) -> list[bool]:
    """Whether nobody else is better in one objective and not worse in the other one, and nobody before is equal."""
    values = np.array([[point.objectives[name].value for name in OBJECTIVES] for point in candidates])
    return [
        not any((other >= one).all() and ((other > one).any() or k < i) for k, other in enumerate(values) if k != i)
        for i, one in enumerate(values)
    ]


def write(params: TuneStudy, run: Run) -> None:
    """Tune all, drive with all, and write parameter files, table, figure and report."""
    asked = preferences(params.pareto, params.score)
    found = searched(params, run, scores=[score for _, score in asked])
    base = as_arrays(params.loop())
    sets = {BEFORE: base}
    for (ratio, _), z in zip(asked, each_best(found), strict=True):
        name = f"comfort x {ratio:.2g}"
        sets[name] = as_arrays(found.search.space.params(jnp.asarray(z, jnp.float32), base))
        about = {"preference": name, "code": code_digest()}
        write_parameters(
            run.path(f"{_file(ratio)}.yaml"), found.search.space.values(jnp.asarray(z, jnp.float32)), about=about
        )
    taus = {f"tau {tau:g}": _with_tau(base, float(tau)) for tau in params.pareto.taus}
    with progress.bar("testing") as tick:
        result = tested.tested(params.tested, {**sets, **taus}, score=params.score, tick=tick)
    every = points(result)
    kinds = {BEFORE: BEFORE, **dict.fromkeys(taus, TAUS)}
    groups = {kind: [point for point in every if kinds.get(point.name, TUNED) == kind] for kind in STYLES}
    front = {point.name: there for point, there in zip(groups[TUNED], on_front(groups[TUNED]), strict=True)}
    table = {
        "parameters": [point.name for point in every],
        **{name: [point.objectives[name].text(3) for point in every] for name in OBJECTIVES},
        **{name: [point.guarded[name].text(3) for point in every] for name in GUARDED},
        **{f"{name} - {BEFORE}": [point.gains[name].text(3) for point in every] for name in OBJECTIVES},
        "at-fault collision [%]": [point.at_fault.text() for point in every],
        "front": [report.cell(front[point.name]) if point.name in front else "-" for point in every],
    }
    progress.show_table("front", table)
    run.table("front", table)
    run.summary(_summary(every, found, sum(front.values())))
    draw(groups, [point for point in groups[TUNED] if front[point.name]], run.path("front.png"))
    items = [report.Picture("Between speed and comfort", run.path("front.png")), report.Table(CAPTION, table)]
    report.write_report(
        run.path("report.html"),
        "A front of parameters",
        sections=[report.Section("One run, many preferences", [], items)],
        manifest=run.manifest("complete"),
    )


def each_best(found: Searched) -> np.ndarray:
    """Of every search the point [N, P] that did best, by its own score, in the scenes that it was judged by."""
    checks = found.search.checks
    losses = np.stack([check.losses.mean(-1) for check in checks])
    z = np.stack([check.z for check in checks])
    return z[losses.argmin(0), np.arange(losses.shape[1])]


def draw(groups: dict[str, list[FrontPoint]], front: list[FrontPoint], path: Path) -> None:
    """What all sets gain over the parameters before. Args: groups, sets by STYLES; front, those on it; path."""
    with figure(path, 6.5, height=4.5) as canvas:
        axes = canvas.subplots()
        for kind, part in groups.items():
            colour, marker = STYLES[kind]
            style: dict[str, Any] = {"color": colour, "elinewidth": 0.6, "ms": 5, "ls": "", "marker": marker}
            for number, point in enumerate(part):
                x, y = (point.gains[name] for name in OBJECTIVES)
                spans = ([[one.value - one.low], [one.high - one.value]] for one in (x, y))
                axes.errorbar(
                    x.value,
                    y.value,
                    **dict(zip(("xerr", "yerr"), spans, strict=True)),
                    **style,
                    label=None if number else kind,
                )
                if kind == TUNED:
                    text = point.name.removeprefix("comfort ")
                    axes.annotate(text, (x.value, y.value), xytext=(4, 4), textcoords="offset points", fontsize=7)
        order = sorted(front, key=lambda point: point.gains["speed"].value)
        line = [[point.gains[name].value for point in order] for name in OBJECTIVES]
        axes.plot(*line, color=GOOD, lw=1, label="front")
        labels = {f"{axis}label": f"{name} - {BEFORE}" for axis, name in zip("xy", OBJECTIVES, strict=True)}
        axes.set(**labels, title="Held-back drives, from the same starts")
        axes.legend(loc="lower left")


def _with_tau(base: LoopParams, tau: float) -> LoopParams:
    return as_arrays(with_values(base, {TAU: tau}))


def _file(ratio: float) -> str:
    return f"comfort_{ratio:.2g}".replace(".", "p")


def _summary(every: list[FrontPoint], found: Searched, count: int) -> dict[str, float]:
    out: dict[str, float] = {"front_points": float(count), "search_s": float(np.sum(found.seconds))}
    for point in every:
        name = point.name.replace(" ", "_")
        for objective, value in {**point.objectives, **point.guarded}.items():
            out |= value.flat(f"{name}_{objective}_score")
        for objective, value in point.gains.items():
            out |= value.flat(f"{name}_less_{BEFORE}_{objective}_score")
        out |= point.at_fault.flat(f"{name}_at_fault_percent")
    return out
