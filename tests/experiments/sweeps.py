"""Made-up sweeps on disk, whose answers are known."""

import csv
import itertools
import json
from pathlib import Path

import numpy as np
import pyarrow
import pyarrow.parquet

from experiments.collect import sweeps
from experiments.collect.axes import axes_of
from experiments.collect.report import write
from experiments.collect.scores import Evidence
from experiments.collect.study import CollectStudy
from urbanjax.io.runs.directory import Run
from urbanjax.rollout import LoopParams
from urbanjax.types import config

TAU, OBSTACLE, GAP = "stack.behavior.gvp.tau", "stack.planning.micro.weights.obstacle", "idm.time_gap"
CODE = "ab" * 32
MISSIONS = ("overtake", "cut_in")


def base(**more):
    """A nested config as an evaluation's manifest has it."""
    return {**config.schema(LoopParams), "idm": {"time_gap": 1.5}, "drivers": ["stack"], "seeds": 8, "seed": 0, **more}


def product(axes):
    """Jobs of a grid. Args: axes, values by key."""
    return [dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]


def plan(folder, overrides, *, kinds=None, experiment="evaluate", name=None, values=None, **more):
    """Write `sweep.json` and nothing else; returns the folder."""
    keys = dict.fromkeys(key for job in overrides for key in job)
    axes = {}
    for key in keys:
        told = (kinds or {}).get(key, "choice")
        axes[key] = {"kind": told} if isinstance(told, str) else dict(told)
        axes[key]["values"] = [job[key] for job in overrides if key in job]
    folder.mkdir(parents=True, exist_ok=True)
    held = {
        "experiment": experiment,
        "sweep": name or folder.name,
        "code": CODE,
        "versions": {"python": "3.11", "urbanjax": "0.1.0"},
        "config": values or base(),
        "command": f"python -m experiments.{experiment} -m ...",
        "axes": axes,
        "jobs": [{"name": f"{i:05d}", "overrides": job} for i, job in enumerate(overrides)],
        **more,
    }
    (folder / "sweep.json").write_text(json.dumps(held))
    return folder


def job(folder, number, *, rows=None, summary=None, status="complete", error=None):
    """Write what one planned job left. Args: number of it; rows, of its drives; summary; status; error."""
    held = json.loads((folder / "sweep.json").read_text())
    named = held["jobs"][number]
    settings = held["config"]
    for key, value in named["overrides"].items():
        settings = replaced(settings, key.split("."), value)
    place = folder / named["name"]
    place.mkdir(exist_ok=True)
    manifest = {"status": status, "error": error, "sweep": held["sweep"], "job": named["name"], "config": settings}
    manifest |= {"overrides": named["overrides"], "summary": summary or {}}
    if rows is not None:
        columns = {key: [row[key] for row in rows] for key in rows[0]}
        pyarrow.parquet.write_table(pyarrow.table(columns), place / "rows.parquet")
    (place / "manifest.json").write_text(json.dumps(manifest))
    return place


def replaced(tree, names, value):
    """A nested dict with one other value."""
    rest = replaced(tree.get(names[0], {}), names[1:], value) if names[1:] else value
    return {**tree, names[0]: rest}


def drives(score, *, seeds=8, missions=MISSIONS, driver="stack", noise=0.05, first=0):
    """Rows of an evaluation whose nuPlan score is `score` and what the start adds: the same for every job."""
    rows = []
    for mission in missions:
        for seed in range(first, first + seeds):
            luck = np.random.default_rng([len(mission), seed]).normal() * noise
            value = float(np.clip(score + luck, 0, 1))
            rows.append(
                {
                    "driver": driver,
                    "traffic": "idm",
                    "localization": "given",
                    "mission": mission,
                    "seed": seed,
                    "success": bool(value > 0.6),
                    "cause": "success" if value > 0.6 else "late",
                    "nuplan_total": value,
                    "competition_time": 20.0 - 10 * value,
                }
            )
    return rows


def sweep(folder, overrides, answer, *, rows=drives, **more):
    """A whole sweep: `answer(overrides)` is the score of each job."""
    plan(folder, overrides, **more)
    for number, values in enumerate(overrides):
        found = rows(answer(values))
        job(folder, number, rows=found, summary={"drives": len(found), "run_s": 3.5 + number})
    return folder


def sampled(axes, count, seed=0):
    """Jobs of a joint sample. Args: axes, (low, high) by key; count; seed."""
    at = np.random.default_rng(seed).random((count, len(axes)))
    return [
        {key: low + (high - low) * x for (key, (low, high)), x in zip(axes.items(), row, strict=True)}
        for row in at.tolist()
    ]


def page(folder: Path) -> str:
    """The text of a report."""
    return (folder / "report.html").read_text(encoding="utf-8")


GRID = product({TAU: [0.0, 0.5, 1.0], OBSTACLE: [1, 2, 4]})


def rising(values):
    return 0.4 + 0.3 * values[TAU] + 0.02 * values.get(OBSTACLE, 0)


def read(*folders):
    """Plans, jobs each once, axes, and evidence of the usual scores."""
    plans = sweeps.sweeps_in([str(folder) for folder in folders])
    jobs, _ = sweeps.unique([job for plan in plans for job in sweeps.jobs_of(plan)])
    return plans, jobs, axes_of(plans, jobs), Evidence(jobs, ["nuplan_total", "success"])


def collect(home, *folders, **asked):
    run = Run(home, {}, None)
    write(CollectStudy(dirs=tuple(map(str, folders)), **asked), run)
    return run


def rows_of(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))
