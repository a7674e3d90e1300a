"""What the rollouts of Fig. 10 amount to: per drive, per value of tau, in all."""

from typing import Any

import numpy as np

from experiments.common.overtaking import Fig10
from urbanjax.evaluation import statistics


def table(found: Fig10) -> dict[str, list[Any]]:
    """Columns by heading, one row per tau: means and counts over the paired starts, with and without the clamp."""
    free = ~found.crowded
    rows: dict[str, list[Any]] = {"tau": found.taus.tolist()}
    rows["progress [m]"] = found.progress[:, 0].mean(-1).tolist()
    rows["speed drop [m/s]"] = found.drop[:, 0].mean(-1).tolist()
    rows["speed drop, lane free [m/s]"] = _mean(found.drop[:, 0], free)
    rows["completed [%]"] = (100 * found.completed[:, 0].mean(-1)).tolist()
    rows["completed, lane free [%]"] = [None if x is None else 100 * x for x in _mean(found.completed[:, 0], free)]
    rows["collisions"] = found.collided[:, 0].sum(-1).tolist()
    rows["least TTC [s]"] = found.ttc[:, 0].min(-1).tolist()
    rows["off the road"] = found.off_road[:, 0].sum(-1).tolist()
    rows["progress, no clamp [m]"] = found.progress[:, 1].mean(-1).tolist()
    rows["speed drop, no clamp [m/s]"] = found.drop[:, 1].mean(-1).tolist()
    rows["collisions, no clamp"] = found.collided[:, 1].sum(-1).tolist()
    return rows


def with_intervals(found: Fig10) -> dict[str, list[Any]]:
    """The table on its side, with intervals where they are known."""
    plain = table(found)
    free = ~found.crowded
    columns: dict[str, Any] = {
        "progress [m]": [statistics.mean(x).text() for x in found.progress[:, 0]],
        "speed drop [m/s]": [statistics.mean(x).text(2) for x in found.drop[:, 0]],
        "speed drop, lane free [m/s]": [statistics.mean(x[free]).text(2) for x in found.drop[:, 0]],
        "completed [%]": [statistics.rate(x).percent.text(0) for x in found.completed[:, 0]],
        "completed, lane free [%]": [statistics.rate(x[free]).percent.text(0) for x in found.completed[:, 0]],
        "progress, no clamp [m]": [statistics.mean(x).text() for x in found.progress[:, 1]],
        "speed drop, no clamp [m/s]": [statistics.mean(x).text(2) for x in found.drop[:, 1]],
    }
    return by_tau({name: columns.get(name, values) for name, values in plain.items()})


def by_tau(rows: dict[str, list[Any]]) -> dict[str, list[Any]]:
    """The table on its side: one row per quantity, one column per tau."""
    names = [name for name in rows if name != "tau"]
    return {"": names, **{f"tau {tau:g}": [rows[name][i] for name in names] for i, tau in enumerate(rows["tau"])}}


def summary(found: Fig10) -> dict[str, Any]:
    """Flat numbers of the study: name with tau and unit, with intervals; gains are paired with the first tau."""
    free = ~found.crowded
    out: dict[str, Any] = {"starts": found.crowded.size, "starts_lane_free": int(free.sum())}
    for i, tau in enumerate(found.taus):
        for k, variant in enumerate(("", "_no_clamp")):
            name = f"tau_{tau:g}{variant}"
            for quantity, values in {
                "progress_m": found.progress[i, k],
                "progress_gain_m": found.progress[i, k] - found.progress[0, k],
                "speed_drop_mps": found.drop[i, k],
                "speed_drop_lane_free_mps": found.drop[i, k][free],
            }.items():
                out |= statistics.mean(values).flat(f"{name}_{quantity}")
            for quantity, happened in {
                "completed_share": found.completed[i, k],
                "completed_lane_free_share": found.completed[i, k][free],
                "collisions_share": found.collided[i, k],
            }.items():
                out |= statistics.rate(happened).flat(f"{name}_{quantity}")
            out[f"{name}_collisions"] = int(found.collided[i, k].sum())
            out[f"{name}_off_road"] = int(found.off_road[i, k].sum())
            out[f"{name}_least_ttc_s"] = found.ttc[i, k].min()
    return out


def _mean(values: np.ndarray, mask: np.ndarray) -> list[float | None]:
    """Means over the masked starts of values [A, S]; None where there are none."""
    return [float(row[mask].mean()) if mask.any() else None for row in values]


def starts(found: Fig10) -> dict[str, Any]:
    """One row per rollout, for the table on disk."""
    shape = found.collided.shape
    index = np.indices(shape).reshape(3, -1)
    return {
        "tau": found.taus[index[0]],
        "clamp": index[1] == 0,
        "start": index[2],
        "lane_free": ~found.crowded[index[2]],
        "initial_speed_mps": found.speed[..., 0].ravel(),
        "progress_m": found.progress.ravel(),
        "speed_drop_mps": found.drop.ravel(),
        "completed": found.completed.ravel(),
        "collided": found.collided.ravel(),
        "least_ttc_s": found.ttc.ravel(),
        "off_road": found.off_road.ravel(),
    }
