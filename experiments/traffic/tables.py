"""What comparing teams came to, as tables of numbers and of text."""

from typing import Any

import jax
import numpy as np

from experiments.traffic.compare import Comparison
from experiments.traffic.teams import Teams
from urbanjax.traffic.flow.passages import gini

Columns = dict[str, list[Any]]
SHORT = ("team", "runs", "samples", "time of a run [s]", "offset [m]", "effective dimension")  # that fit a terminal


def team_table(teams: Teams, found: Comparison) -> Columns:
    """One row per team: what it drove."""
    count = teams.valid.sum(1)

    def mean(values: np.ndarray) -> list[float]:
        return ((values * teams.valid).sum(1) / count).tolist()

    def std(values: np.ndarray) -> list[float]:
        return [float(v[m].std()) for v, m in zip(values, teams.valid, strict=True)]

    return {
        "team": list(teams.names),
        "runs": teams.runs.tolist(),
        "samples": count.tolist(),
        "repeated samples": found.estimate.dropped.tolist(),
        "time of a run [s]": [float(times.mean()) for times in teams.lap_times],
        "Gini of the times": [_gini(times) for times in teams.lap_times],
        "speed [m/s]": mean(teams.speed),
        "offset [m]": mean(teams.offset),
        "its deviation [m]": std(teams.offset),
        "effective dimension": found.dimension.tolist(),
    }


def _gini(times: np.ndarray) -> float:
    return float(_gini_of(times.astype(np.float32), np.ones(len(times), bool)))


_gini_of = jax.jit(gini)


def pair_table(teams: Teams, found: Comparison) -> Columns:
    """One row per ordered pair and k: everything that is known of it."""
    rows: Columns = {}

    def add(name: str, value: Any) -> None:
        rows.setdefault(name, []).append(value.item() if hasattr(value, "item") else value)

    for p, (i, j) in enumerate(found.pairs):
        for c, k in enumerate(found.ks):
            add("P", teams.names[i])
            add("Q", teams.names[j])
            add("k", k or "adaptive")
            add("divergence [nats]", _or_none(found.estimate.value[p, c], found.estimate.valid[p, c]))
            sure = found.interval.valid[p, c]
            add("low", _or_none(found.interval.low[p, c], sure))
            add("high", _or_none(found.interval.high[p, c], sure))
            add("null mean", _or_none(found.swap.null[p, :, c].mean(), found.swap.valid[p, c]))
            add("excess", _or_none(found.swap.excess[p, c], found.swap.valid[p, c]))
            add("p", _or_none(found.swap.share[p, c], found.swap.valid[p, c]))
            at = len(found.ks) + c
            add("P(x|z)", _or_none(found.given.value[p, c], found.given.valid[p, c]))
            add("P(x|z) excess", _or_none(found.swap.excess[p, at], found.swap.valid[p, at]))
            add("P(x|z) p", _or_none(found.swap.share[p, at], found.swap.valid[p, at]))
            add("ties own", found.estimate.ties_own[p, c])
            add("ties other", found.estimate.ties_other[p, c])
            for to, away in (("samples", found.samples), ("line", found.routes.there)):
                add(f"mean to {to} [m]", away.mean[p])
                add(f"rmse to {to} [m]", away.rmse[p])
                add(f"Hausdorff to {to} [m]", away.hausdorff[p])
    return rows


def _or_none(value: Any, valid: Any) -> float | None:
    return float(value) if bool(valid) else None


def matrix(teams: Teams, found: Comparison, cells: list[str]) -> Columns:
    """Cells of the ordered pairs as rows P by columns Q."""
    by_pair = dict(zip(found.pairs, cells, strict=True))
    rows: Columns = {"P \\ Q": list(teams.names)}
    for j, name in enumerate(teams.names):
        rows[name] = [by_pair.get((i, j), "-") for i in range(len(teams.names))]
    return rows


def matrices(teams: Teams, found: Comparison) -> dict[str, Columns]:
    """The tables like Table III, by caption: divergence with its interval, excess over the null, distance."""
    c, last = found.middle, len(found.ks)
    k = f"k = {found.ks[c]}" if found.ks[c] else "adaptive k"
    value, low, high = found.estimate.value[:, c], found.interval.low[:, c], found.interval.high[:, c]
    ranges = [
        f" [{a:.2f}, {b:.2f}]" if ok else "" for a, b, ok in zip(low, high, found.interval.valid[:, c], strict=True)
    ]
    good = found.estimate.valid[:, c]
    divergences = [f"{v:.2f}{text}" if ok else "-" for v, text, ok in zip(value, ranges, good, strict=True)]

    def excess(column: int) -> list[str]:
        swap = found.swap
        cells = zip(swap.excess[:, column], swap.share[:, column], swap.valid[:, column], strict=True)
        return [f"{v:.2f} (p = {p:.2f})" if ok else "-" for v, p, ok in cells]

    means = [f"{m:.2f} / {r:.2f}" for m, r in zip(found.samples.mean, found.routes.there.mean, strict=True)]
    return {
        f"Divergence of P from Q [nats], {k}, with its interval": matrix(teams, found, divergences),
        f"What of it exceeds laps dealt out anew, {k} (share of deals that give as much)": matrix(
            teams, found, excess(c)
        ),
        f"The same, of the lateral offset given the station, P(x | z), {k}": matrix(teams, found, excess(last + c)),
        "Mean distance of P to the samples of Q (Eq. 33) / to the line through them [m]": matrix(teams, found, means),
    }


def area_table(teams: Teams, found: Comparison) -> Columns:
    """One row per area and ordered pair, as in Tables IV to VII."""
    rows: Columns = {name: [] for name in ("area", "P", "Q", "divergence [nats]", "mean [m]", "rmse [m]", "samples")}
    for a, name in enumerate(teams.areas.names):
        for p, (i, j) in enumerate(found.pairs):
            near = bool(found.areas["near"][a, p])
            values = (
                name,
                teams.names[i],
                teams.names[j],
                _or_none(found.areas["value"][a, p], found.areas["valid"][a, p]),
                _or_none(found.areas["mean"][a, p], near),
                _or_none(found.areas["rmse"][a, p], near),
                int(found.areas["samples"][a, i]),
            )
            for column, value in zip(rows.values(), values, strict=True):
                column.append(value)
    return rows


def area_summary(teams: Teams, found: Comparison) -> Columns:
    """One row per area: root mean square distance of each team to the others, and the divergence of all pairs."""
    rows: Columns = {"area": list(teams.areas.names)}
    rows["from [m]"] = np.asarray(teams.areas.start).round(0).tolist()
    rows["to [m]"] = np.asarray(teams.areas.end).round(0).tolist()
    first = np.array([i for i, _ in found.pairs])
    for t, name in enumerate(teams.names):
        mine = first == t
        rows[f"{name} RMSE [m]"] = [
            _mean(r[mine], n[mine]) for r, n in zip(found.areas["rmse"], found.areas["near"], strict=True)
        ]
    rows["mean divergence"] = [
        _mean(value, valid) for value, valid in zip(found.areas["value"], found.areas["valid"], strict=True)
    ]
    return rows


def _mean(values: np.ndarray, valid: np.ndarray) -> float | None:
    return float(values[valid].mean()) if valid.any() else None


def summary(teams: Teams, found: Comparison) -> dict[str, float]:
    """Flat numbers by name."""
    numbers: dict[str, float] = {"teams": float(len(teams.names)), "course_m": teams.length}
    c, last = found.middle, len(found.ks)
    for p, (i, j) in enumerate(found.pairs):
        name = f"{teams.names[i]}_{teams.names[j]}".replace(" ", "_")
        if found.estimate.valid[p, c]:
            numbers[f"divergence_{name}_nats"] = float(found.estimate.value[p, c])
        if found.swap.valid[p, c]:
            numbers[f"excess_{name}_nats"] = float(found.swap.excess[p, c])
        if found.swap.valid[p, last + c]:
            numbers[f"excess_given_station_{name}_nats"] = float(found.swap.excess[p, last + c])
        numbers[f"mean_distance_{name}_m"] = float(found.samples.mean[p])
    return numbers
