"""What the predictions amount to, with intervals over drivers."""

from typing import Any

import numpy as np

from experiments.tune.imitation.paths import PathStudy
from experiments.tune.imitation.predictors import CONSTANT, LINEAR, NETWORK, WIDER, Predictions, Study
from experiments.tune.imitation.recovery import Recovered
from experiments.tune.imitation.task import RecordedDrivers
from urbanjax.evaluation import statistics
from urbanjax.evaluation.statistics import WithInterval


def measured(
    found: Predictions, drivers: RecordedDrivers, *, among: np.ndarray | None = None
) -> dict[str, WithInterval]:
    """ADE and FDE at 3 s, log density and log share: means over demonstrations, drawn by driver."""
    some = np.ones(len(drivers.file), bool) if among is None else among
    values = {
        "ade_m": found.error.mean(axis=1),
        "fde_m": found.error[:, -1],
        "log_density_nat": found.likelihood,
        "log_share_nat": found.share,
    }
    nothing = WithInterval(np.nan, np.nan, np.nan)
    return {
        name: statistics.mean(x[some], groups=drivers.driver[some]) if np.isfinite(x[some]).all() else nothing
        for name, x in values.items()
    }


def predictors(study: Study, drivers: RecordedDrivers) -> dict[str, list[Any]]:
    """One row for each predictor."""
    rows = [measured(found, drivers) for found in study.predictions.values()]
    return {
        "parameters": list(study.predictions),
        "ADE [m]": [row["ade_m"].text(2) for row in rows],
        "FDE at 3 s [m]": [row["fde_m"].text(2) for row in rows],
        "log density [nat]": [row["log_density_nat"].text(2) for row in rows],
        "log share of the nearest [nat]": [row["log_share_nat"].text(2) for row in rows],
    }


def by_file(study: Study, drivers: RecordedDrivers) -> dict[str, list[Any]]:
    """FDE of each predictor in each file, which its parameters have not seen."""
    among = {name: drivers.file == name for name in drivers.files}
    columns: dict[str, list[Any]] = {
        "file": list(among),
        "drivers": [len(set(drivers.driver[some])) for some in among.values()],
        "moments": [int(some.sum()) for some in among.values()],
    }
    for name, found in study.predictions.items():
        columns[name] = [measured(found, drivers, among=some)["fde_m"].text(2) for some in among.values()]
    return columns


def differences(study: Study, drivers: RecordedDrivers, other: str = WIDER) -> dict[str, WithInterval]:
    """FDE [m] of each predictor less that of another one, paired, drawn by driver.

    By default the other one is the default parameters with the same fan, so that the difference is of tuning alone.
    """
    base = study.predictions[other].error[:, -1]
    return {
        name: statistics.paired(found.error[:, -1], base, groups=drivers.driver)
        for name, found in study.predictions.items()
        if name != other
    }


def paired_rows(study: Study, drivers: RecordedDrivers) -> dict[str, list[Any]]:
    """Paired differences of FDE against the default of the same fan, and of some others against the tuned linear."""
    found = {f"{name} - {WIDER}": value for name, value in differences(study, drivers).items()}
    against = differences(study, drivers, LINEAR)
    found |= {f"{name} - {LINEAR}": against[name] for name in (NETWORK, CONSTANT)}
    return {"FDE at 3 s": list(found), "difference [m]": [value.text(2) for value in found.values()]}


def verdict(study: Study, drivers: RecordedDrivers) -> str:
    """One sentence: whether constant velocity is nearer to the drivers than what was tuned."""
    fde = measured(study.predictions[CONSTANT], drivers)["fde_m"].text(2)
    told = []
    for name in (LINEAR, NETWORK):
        gap = differences(study, drivers, name)[CONSTANT]
        how = (
            "better than" if gap.high < 0 else "worse than" if gap.low > 0 else "neither clearly better nor worse than"
        )
        told.append(f"{how} '{name}' (by {gap.text(2)} m)")
    return f"Constant velocity, {fde} m, predicts {' and '.join(told)}."


def weights(study: Study, start: dict[str, float]) -> dict[str, list[Any]]:
    """Values before, and after each search, by the file that was left out."""
    keys = list(start)
    columns: dict[str, list[Any]] = {"number": [key.removeprefix("stack.planning.") for key in keys]}
    columns["before"] = [start[key] for key in keys]
    for name, (_, fan, linear) in study.fits.items():
        after = numbers(fan.space, fan.z) | numbers(linear.space, linear.z)
        columns[f"without {name}"] = [after[key] for key in keys]
    return columns


def numbers(space: Any, z: np.ndarray) -> dict[str, float]:
    """Each tuned number at z, elements of tuples apart."""
    flat: dict[str, float] = {}
    for key, value in space.values(np.asarray(z, np.float32)).items():
        parts = {f"{key}[{i}]": x for i, x in enumerate(value)} if isinstance(value, list) else {key: value}
        flat |= {name: float(x) for name, x in parts.items() if name in space.keys}
    return flat


def recovered(found: dict[str, Recovered]) -> dict[str, list[Any]]:
    """One row for each kind of planted weights."""
    return {
        "weights of": list(found),
        "choices": [row.choices for row in found.values()],
        "cosine": [f"{row.cosine:.4f}" for row in found.values()],
        "regret [%]": [f"{100 * row.regret:.3f}" for row in found.values()],
        "planted / found (share of what costs differ by)": [
            ", ".join(f"{k.rpartition('.')[2]} {a:.3g} / {b:.3g} ({c:.1%})" for k, (a, b, c) in row.weights.items())
            for row in found.values()
        ],
        "left out, since nothing informs it": [", ".join(row.uninformed) for row in found.values()],
    }


def verdict_of_paths(study: PathStudy, drivers: RecordedDrivers) -> str:
    """One sentence: where tuned weights make paths of files that they have not seen likelier, and where they do not."""
    gain = study.tuned - study.default
    of_file = {name: study.use & (drivers.file == name) for name in drivers.files}
    found = {
        name: statistics.mean(gain[some], groups=drivers.driver[some]) for name, some in of_file.items() if some.any()
    }
    better = sum(value.low > 0 for value in found.values())
    worse = ", ".join(f"{name} ({value.text(2)})" for name, value in found.items() if value.high < 0)
    every = statistics.mean(gain[study.use], groups=drivers.driver[study.use]).text(2)
    return (
        f"Tuned weights make paths clearly likelier in {better} of {len(found)} files"
        f"{f' and less likely in {worse}' if worse else ''}; over all of them by {every} nat per layer."
    )


def paths(study: PathStudy, drivers: RecordedDrivers) -> dict[str, list[Any]]:
    """Log-likelihood per layer by file that the weights have not seen, and of all."""
    rows = {name: study.use & (drivers.file == name) for name in drivers.files} | {"all": study.use}
    of_file = {name: drivers.file == name for name in drivers.files} | {"all": np.ones(len(drivers.file), bool)}

    def text(values: np.ndarray, some: np.ndarray) -> str:
        return statistics.mean(values[some], groups=drivers.driver[some]).text(3)

    return {
        "file": list(rows),
        "paths": [int(some.sum()) for some in rows.values()],
        "left out": [int((of_file[name] & ~some).sum()) for name, some in rows.items()],
        "layers of a path": [float(study.layers[some].mean()) if some.any() else np.nan for some in rows.values()],
        "default [nat per layer]": [text(study.default, some) for some in rows.values()],
        "tuned [nat per layer]": [text(study.tuned, some) for some in rows.values()],
        "difference": [text(study.tuned - study.default, some) for some in rows.values()],
    }
