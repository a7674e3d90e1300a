"""Parameters tuned by gradient of closed loops, tested in drives of which nothing was seen while tuning."""

import os
import shlex
import sys
from typing import Any

import jax.numpy as jnp
import numpy as np

from experiments.tune import figures, tested
from experiments.tune.card import card
from experiments.tune.search import Searched, begun, searched
from experiments.tune.study import TuneStudy
from experiments.tune.tested import HeldBackDrives
from urbanjax.evaluation.batch import Job, outcomes
from urbanjax.evaluation.missions import MISSIONS
from urbanjax.evaluation.road_users import until_end
from urbanjax.io.runs import progress, report
from urbanjax.io.runs.directory import Run, write_atomically
from urbanjax.io.runs.networks import save_learned
from urbanjax.io.runs.parameter_file import write_parameters
from urbanjax.io.runs.sweeps.code import code_digest
from urbanjax.tuning.tune import Tuned, outcome
from urbanjax.types import as_arrays

DEFAULT, TUNED = "before", "tuned"
PARAMETERS, NETWORK, CARD = "tuned.yaml", "network.safetensors", "card.md"
SHOWN = 5  # scenes that got worse, and those that differ most
JUDGED = (
    "Scores of scenes of {horizon:g} s as deployed, which decided which point is best and when to stop; so they are "
    "hopeful. Brackets: 95 % bootstrap intervals, whole roads drawn"
)
TESTED = (
    "Whole drives from the same starts, of other missions than those of the search, unless others were asked for. "
    "Brackets: 95 % intervals, of shares Wilson's, of means and paired differences from drawing whole roads"
)


def write(params: TuneStudy, run: Run) -> None:
    """Tune, test, and write parameters, card, tables, figures and report."""
    found = searched(params, run)
    base = begun(params)
    tuned = outcome(found.search, base)
    where = run.path(PARAMETERS)
    write_parameters(where, tuned.values, about=_about(params, tuned, where))
    learned = tuned.params.stack.planning.micro.learned
    if learned is not None:
        save_learned(run.path(NETWORK), learned)
    _write_search(found, run)
    sections = [_search_section(found, tuned, run)]
    result = None
    if params.tested.missions:
        with progress.bar("testing") as tick:
            sets = {DEFAULT: base, TUNED: as_arrays(tuned.params)}
            result = tested.tested(params.tested, sets, score=params.score, tick=tick)
            sections.append(_test_section(params, result, tuned, run, tick))
    write_atomically(run.path(CARD), card(params, found, tuned=tuned, result=result))
    report.write_report(
        run.path("report.html"), "Tuned in closed loops", sections=sections, manifest=run.manifest("complete")
    )
    print(f"parameters: {os.path.relpath(where)}; what they are good for: {os.path.relpath(run.path(CARD))}")


def _about(params: TuneStudy, tuned: Tuned, where: Any) -> dict[str, str]:
    if params.network:
        use = {"only half of it": f"the rest is {NETWORK} beside it, see `urbanjax.io.runs.networks.load_learned`"}
    else:
        use = {"drive it with": f"python -m experiments.evaluate params={os.path.relpath(where)}"}
    return {
        "tuned by": shlex.join(sys.orig_argv),
        "score": f"{tuned.gain.text(3)} better in the scenes that it was judged by",
        **use,
        "code": code_digest(),
    }


def _write_search(found: Searched, run: Run) -> None:
    """Tables and figures of the search."""
    epochs = found.epochs
    columns: dict[str, list[Any]] = {name: [getattr(epoch, name) for epoch in epochs] for name in vars(epochs[0])}
    run.table("epochs", {**columns, "seconds": list(found.seconds), "cost": figures.costs(found)})
    search = found.search
    z, _ = search.best
    numbers = search.space.numbers
    after = search.space.values(jnp.asarray(z, jnp.float32))
    run.table(
        "values",
        {
            "key": [number.key for number in numbers],
            "unit": [number.unit for number in numbers],
            "before": [number.value for number in numbers],
            "tuned": [_of(after, number.key) for number in numbers],
            "z": z[: len(numbers)],
        },
    )
    figures.draw_convergence(found, run.path("convergence.png"))
    figures.draw_values(found, run.path("values.png"))


def _of(values: dict[str, Any], key: str) -> float:
    """The value of a key, also of an element of a tuple."""
    field, _, place = key.partition("[")
    return values[field][int(place[:-1])] if place else values[field]


def _search_section(found: Searched, tuned: Tuned, run: Run) -> report.Section:
    search, numbers = found.search, tuned.gain
    seconds = float(np.sum(found.seconds))
    spent = float(figures.costs(found)[-1])
    run.summary(
        {
            "judged_score_before": -float(search.first.mean()),
            "judged_score_tuned": -float(search.best[1].mean()),
            **numbers.flat("judged_gain_score"),
            "generations": search.generation,
            "search_s": seconds,
            "cost_forward_evaluations": spent,
            "cost_of_gradient": found.multiple,
            "parameters": search.space.size,
        }
    )
    line = {
        "parameters": [search.space.size],
        "generations": [search.generation],
        "time [s]": [seconds],
        "cost [forward evaluations]": [spent],
        "of a gradient": [found.multiple],
        "score before": [-float(search.first.mean())],
        "score tuned": [-float(search.best[1].mean())],
        "gain": [numbers.text(3)],
    }
    progress.show_table("search", line)
    horizon = search.steps[-1] * search.period
    values = {key: [_short(value)] for key, value in tuned.values.items()}
    return report.Section(
        "The search",
        [],
        [
            report.Table(JUDGED.format(horizon=horizon), line),
            report.Picture("The score while it was tuned; dotted, where the horizon grew", run.path("convergence.png")),
            report.Picture("The numbers over generations", run.path("values.png")),
            report.Table("What was found", {"key": list(values), "tuned": [value[0] for value in values.values()]}),
        ],
    )


def _short(value: Any) -> Any:
    return ", ".join(f"{x:.4g}" for x in value) if isinstance(value, list) else value


def _test_section(params: TuneStudy, result: HeldBackDrives, tuned: Tuned, run: Run, tick: Any) -> report.Section:
    table = tested.table(result)
    run.summary(tested.summary(result))
    progress.show_table("tested", table)
    for name, rows in result.rows.items():
        run.table(f"tested_{name}", {key: [row.get(key) for row in rows] for key in rows[0]})
    figures.draw_differences(result, TUNED, run.path("differences.png"))
    tick("driving the scenes that differ most", 1.0)
    shown = _most_changed(params, result, tuned)
    figures.draw_before_after(shown, run.path("before_after.png"))
    lost = tested.worse(result, TUNED, SHOWN)
    worst = {
        "mission": [after["mission"] for _, after in lost],
        "seed": [after["seed"] for _, after in lost],
        "traffic": [after["traffic"] for _, after in lost],
        "score before": [before["score"] for before, _ in lost],
        "score tuned": [after["score"] for _, after in lost],
        "success before": [bool(before["success"]) for before, _ in lost],
        "success tuned": [bool(after["success"]) for _, after in lost],
    }
    return report.Section(
        "Tested",
        [],
        [
            report.Table(TESTED, table),
            report.Picture("Scores before and after", run.path("differences.png")),
            report.Picture("The drives that changed most, before and after", run.path("before_after.png")),
            report.Table("The drives that got worse most", worst),
        ],
    )


def _most_changed(params: TuneStudy, result: HeldBackDrives, tuned: Tuned) -> list[tuple[str, Any, Any]]:
    """Title and both logs of the drives whose score changed most, of one each of a mission and traffic."""
    pairs = list(zip(result.rows[DEFAULT], result.rows[TUNED], strict=True))
    order = sorted(pairs, key=lambda pair: -abs(pair[1]["score"] - pair[0]["score"]))
    chosen = {(after["mission"], after["traffic"]): (before, after) for before, after in reversed(order)}
    found = []
    for before, after in sorted(chosen.values(), key=lambda pair: -abs(pair[1]["score"] - pair[0]["score"]))[:SHOWN]:
        jobs = [Job(MISSIONS[after["mission"]], after["seed"], which) for which in (0, 1)]
        sets = [begun(params), as_arrays(tuned.params)]
        logs = [until_end(one) for one in outcomes(sets, jobs, traffic=after["traffic"], logs=True)]
        title = f"{after['mission']} {after['seed']}, {after['traffic']}: {before['score']:.2f} to {after['score']:.2f}"
        found.append((title, *logs))
    return found
