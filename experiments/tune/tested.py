"""Whole drives with the parameters of before and with the tuned ones, from the same starts, as deployed."""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from experiments.common.scenes import scenes
from experiments.tune.study import HeldBackParams
from urbanjax.evaluation import statistics
from urbanjax.evaluation.batch import Job, Outcome, outcomes
from urbanjax.evaluation.facts import ROUNDING
from urbanjax.evaluation.missions import MISSIONS
from urbanjax.evaluation.scores import ScoreParams, terms
from urbanjax.rollout import LoopParams
from urbanjax.sim.log import Log
from urbanjax.types import host_record
from urbanjax.vehicle.params import VehicleParams

MEASURES = {  # title of each column, and whether it is a share
    "score": ("score that was tuned", False),
    "nuplan_total": ("nuPlan score", False),
    "success": ("success [%]", True),
    "competition_at_fault": ("at-fault collision [%]", True),
    "competition_off_road": ("off the road [%]", True),
    "mean_speed": ("mean speed [m/s]", False),
}


@host_record
class HeldBackDrives:
    """Drives of every parameter set, row by row from the same starts."""

    names: tuple[str, ...]  # of the sets; the first is what others are compared with
    rows: dict[str, list[dict[str, Any]]]  # by the name of the set


def tested(
    params: HeldBackParams, sets: dict[str, LoopParams], *, score: ScoreParams, tick: Callable[[str, float], None]
) -> HeldBackDrives:
    """The drives of all sets. Args: sets, loops by name; score, that was tuned; tick, told how far it is."""
    jobs = [
        Job(MISSIONS[name], params.seed + k, which)
        for name in params.missions
        for k in range(params.seeds)
        for which in range(len(sets))
    ]
    names, rows = tuple(sets), {name: [] for name in sets}
    total, done = max(len(jobs) * len(params.traffic), 1), 0
    for traffic in params.traffic:
        for one in outcomes(list(sets.values()), jobs, traffic=traffic, logs=True):
            rows[names[one.job.params]].append(_row(one, list(sets.values())[one.job.params].vehicle, score))
            done += 1
            tick(f"driving {traffic}, {done} of {total}", done / total)
    return HeldBackDrives(names, rows)


def table(found: HeldBackDrives) -> dict[str, list[Any]]:
    """Every measure of every set, and what the others have more than the first one, with intervals."""
    first, *others = found.names
    columns: dict[str, list[Any]] = {"traffic": [], "drives": [], "measure": [], first: []}
    columns |= {name: [] for other in others for name in (other, f"{other} - {first}")}
    for traffic in (*dict.fromkeys(row["traffic"] for row in found.rows[first]), "all"):
        part = {name: _among(rows, traffic) for name, rows in found.rows.items()}
        for measure, (title, share) in MEASURES.items():
            digits = 1 if share else 3
            columns["traffic"].append(traffic)
            columns["drives"].append(len(part[first]))
            columns["measure"].append(title)
            for name, rows in part.items():
                value = _value(rows, measure, share)
                columns[name].append(value.text(digits))
                if name != first:
                    columns[f"{name} - {first}"].append(difference(part, name, measure, first=first).text(digits))
    return columns


def summary(found: HeldBackDrives) -> dict[str, float]:
    """The same as flat numbers, of all traffic together."""
    first, *others = found.names
    out: dict[str, float] = {"tested_drives": float(len(found.rows[first]))}
    for measure, (_, share) in MEASURES.items():
        unit = "percent" if share else {"mean_speed": "mps"}.get(measure, "score")
        measured = measure if measure == unit else f"{measure}_{unit}"
        for name, rows in found.rows.items():
            out |= _value(rows, measure, share).flat(f"tested_{name}_{measured}")
        for name in others:
            out |= difference(found.rows, name, measure, first=first).flat(f"tested_{name}_less_{first}_{measured}")
    return out


def difference(
    rows: dict[str, list[dict[str, Any]]], name: str, measure: str, *, first: str
) -> statistics.WithInterval:
    """What a set has more than the first one, whole roads drawn. Args: rows by set; name of it; measure; first."""
    ours, theirs = ([float(row[measure]) for row in rows[one]] for one in (name, first))
    found = statistics.paired(ours, theirs, groups=scenes(rows[first]))
    return found.percent if MEASURES[measure][1] else found


def worse(found: HeldBackDrives, name: str, count: int) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """The drives that lost most of the score, with those of before. Args: name, of the set; count, at most."""
    pairs = list(zip(found.rows[found.names[0]], found.rows[name], strict=True))
    lost = [pair for pair in pairs if pair[1]["score"] < pair[0]["score"]]
    return sorted(lost, key=lambda pair: pair[1]["score"] - pair[0]["score"])[:count]


def _among(rows: Sequence[dict[str, Any]], traffic: str) -> list[dict[str, Any]]:
    return [row for row in rows if traffic in ("all", row["traffic"])]


def _value(rows: list[dict[str, Any]], measure: str, share: bool) -> statistics.WithInterval:
    values = [row[measure] for row in rows]
    return statistics.rate(values).percent if share else statistics.mean(values, groups=scenes(rows))


def _row(one: Outcome, vehicle: VehicleParams, wanted: ScoreParams) -> dict[str, Any]:
    assert one.log is not None
    since = one.log.time - one.log.time[0]
    counts = since <= max(float(one.row["duration_s"]) + ROUNDING, float(since[1]))
    score = jax.device_get(_score(one.log, one.vehicle or vehicle, wanted, counts))
    told = {name: float(getattr(score, name)) for name in vars(score) if name != "total"}
    speed = float(np.mean(np.asarray(one.log.ego.speed)[counts]))
    row = {name: value.item() if hasattr(value, "item") else value for name, value in one.row.items()}
    row |= {name: row[name] > 0 for name, (_, share) in MEASURES.items() if share}
    return {**row, "score": float(score.total), "mean_speed": speed, **{f"score_{k}": v for k, v in told.items()}}


@functools.partial(jax.jit)
def _score(log: Log, vehicle: VehicleParams, params: ScoreParams, counts: jax.Array) -> Any:
    return terms(jax.tree.map(jnp.asarray, log), vehicle, params=params, counts=counts)
