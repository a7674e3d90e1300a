"""One drive of an evaluation once more, with a moving picture and the reasons of the moment that decided."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from experiments.evaluate import figures, study
from experiments.evaluate.study import EvaluateStudy
from urbanjax.evaluation.batch import Job, case_of, moment, outcomes
from urbanjax.evaluation.verdict import Cause
from urbanjax.io.figures import animation, drives
from urbanjax.io.runs import interpolation, progress, report
from urbanjax.io.runs.directory import Run, digest
from urbanjax.io.runs.report import cell
from urbanjax.planning.explain import explain
from urbanjax.stack import StackInfo
from urbanjax.types import ConfigError, Decision
from urbanjax.types.config import to_params

PATHS = ("route", "micro", "ego lane")
EVERY = 1  # steps between pictures


def write(params: EvaluateStudy, run: Run) -> None:
    """Drive the row again, compare, draw, and explain."""
    rows = study.rows_of(params.replay, "replay")
    if params.row >= len(rows):
        raise ConfigError(f"row={params.row}: {params.replay} holds the rows 0 to {len(rows) - 1}")
    row = rows[params.row]
    then = _params_of(params.replay)
    asked = study.missions_of(then)
    if row["mission"] not in asked:
        raise ConfigError(f"row={params.row}: there is no mission {row['mission']!r} any more")
    loop = study.loop_of(then, row["driver"])
    job = Job(asked[row["mission"]], row["seed"])
    title = f"{row['driver']}, {row['mission']}, seed {row['seed']}, {row['traffic']} traffic: {row['cause']}"
    with progress.bar("replay") as tick:
        tick(title)
        (one,) = outcomes(loop, [job], traffic=row["traffic"], logs=True, epdms=then.epdms)
        again = {**study.row_of(row["driver"], one), "cause": Cause(int(one.row["cause"])).label}
        differs = [name for name in row if not _same(row[name], again.get(name))]
        log, graph, vehicle = study.until_end(one, case_of(loop, job, traffic=row["traffic"]), loop.vehicle)
        frames = figures.moving(log, graph, vehicle, every=EVERY, title=title)
        animation.write_gif(run.path("replay.gif"), frames, rate=1.0 / (EVERY * float(loop.period)))
        drives.drive(log, graph, path=run.path("replay.png"), vehicle=vehicle)
        when = row["cause_time_s"] if np.isfinite(row["cause_time_s"]) else row["duration_s"]
        time = max(when - float(params.before), 0.0)
        tick(f"asking why at {time:.1f} s")
        info = moment(loop, job, traffic=row["traffic"], time=time)
    run.summary({"columns": len(row), "columns_that_differ": len(differs), "asked_at_s": time})
    same = "equal to the row bit for bit" if not differs else f"differs from the row in {', '.join(differs)}"
    items: list[report.Table | report.Picture] = [
        report.Table(
            f"The drive, {same}",
            {"column": list(row), "then": list(row.values()), "now": [again.get(name) for name in row]},
        ),
        report.Picture(title, run.path("replay.gif")),
        report.Picture("The same over time", run.path("replay.png")),
    ]
    for name, columns in reasons(info).items():
        columns = {heading: [cell(value) for value in column] for heading, column in columns.items()}
        run.table(name.replace(" ", "_"), columns)
        progress.show_table(f"{name} at {time:.1f} s", columns)
        items.append(report.Table(f"{name} at {time:.1f} s", columns))
    print(f"{title}; {same}")
    report.write_report(
        run.path("report.html"), title, sections=[report.Section(title, [], items)], manifest=run.manifest("complete")
    )


def reasons(info: Any) -> dict[str, dict[str, list[Any]]]:
    """Tables of why a driver did what it did; of another than the stack what it says of itself."""
    if not isinstance(info, StackInfo):
        return {}
    selection, speed = info.choice.selection, info.speed_plan
    path, decision = int(np.argmax(selection.path)), Decision(int(np.argmax(selection.decision)))
    limits = {"speed limit, curves, stop line": speed.cap, "time-to-collision clamp": speed.clamp}
    limits |= {"vehicle ahead in the target lane": speed.lanes.target, "vehicle ahead in the own lane": speed.lanes.ego}
    bound = min(limits, key=lambda name: float(limits[name]))
    chosen = {
        "path": PATHS[path],
        "decision": decision.name.lower().replace("_", " "),
        "clearance of route, micro, ego lane [m]": ", ".join(f"{float(x):.2f}" for x in info.choice.clearance),
        "reference speed [m/s]": float(speed.reference),
        "least of its limits": bound,
        **{f"limit: {name} [m/s]": float(value) for name, value in limits.items()},
        "emergency": float(selection.emergency),
    }
    return {
        "what was chosen": {"quantity": list(chosen), "value": list(chosen.values())},
        "why this plan": explain(info.plan),
    }


def _params_of(directory: str) -> EvaluateStudy:
    """The params of a run, from its manifest."""
    path = Path(directory) / "manifest.json"
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
        config, theirs = manifest["config"], manifest["config_sha256"]
    except (OSError, ValueError, KeyError) as error:
        raise ConfigError(f"replay={directory}: its manifest.json cannot be read: {error}") from error
    values = interpolation.resolved(config)
    if values != config and digest(values) != theirs:
        raise ConfigError(
            f"replay={directory}: its ${{...}} stood for other values; set the environment as it was then"
        )
    return to_params(EvaluateStudy, values, source=str(path))


def _same(one: Any, other: Any) -> bool:
    return one == other or (one != one and other != other)
