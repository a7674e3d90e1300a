"""What the drives among recorded traffic amount to."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from experiments.recorded.driving import Drive
from urbanjax.evaluation import statistics
from urbanjax.evaluation.collisions import Contact
from urbanjax.evaluation.statistics import WithInterval

ALL = "all"
# Columns that fit a terminal.
SHORT = ("scene", "drives", "no at-fault collision [%]", "off the road [%]", "progress of the human's [%]")
AT_LEAST = 1.0  # m, a recorded drive of less has no ratio


def scenes_of(drives: Sequence[Drive]) -> dict[str, list[Drive]]:
    """The drives of each scene, and of all of them."""
    names = list(dict.fromkeys(drive.scene for drive in drives))
    return {name: [d for d in drives if d.scene == name] for name in names} | {ALL: list(drives)}


def score(drives: Sequence[Drive]) -> dict[str, WithInterval]:
    """Shares, progress and comfort of some drives by name with unit: Wilson intervals, and bootstrap ones by scene."""
    way, human = (np.array([getattr(d, name) for d in drives]) for name in ("way", "human_way"))
    scene = [d.scene for d in drives]
    moved = human > AT_LEAST
    ratio, moved_in = way[moved] / human[moved], [s for s, there in zip(scene, moved, strict=True) if there]

    def ratios(statistic: Callable[[np.ndarray], float]) -> WithInterval:
        return statistics.bootstrap(lambda i: statistic(ratio[i]), len(ratio), groups=moved_in).percent

    out = {
        "no_at_fault_collision_percent": statistics.rate([not d.at_fault for d in drives]).percent,
        "off_road_percent": statistics.rate([d.off_road for d in drives]).percent,
        "progress_percent": statistics.bootstrap(
            lambda i: way[i].sum() / human[i].sum() if human[i].sum() > 0 else np.nan, len(drives), groups=scene
        ).percent,
        "progress_median_percent": ratios(lambda x: float(np.median(x))),
        "progress_capped_percent": ratios(lambda x: float(np.minimum(x, 1).mean())),
    }
    for whose in ("", "human_"):
        acceleration, jerk, lateral = zip(*(_changes(drive, whose) for drive in drives), strict=True)
        found = *map(_root_mean_square, (acceleration, jerk, lateral)), _percentile([-x for x in acceleration])
        for (name, unit), statistic in zip(COMFORT.items(), found, strict=True):
            out[f"{whose}{name}_{unit}"] = statistics.bootstrap(statistic, len(drives), groups=scene)
    return out


def counts(drives: Sequence[Drive]) -> dict[str, int]:
    """What is counted and not estimated."""
    others = sum(d.contact != Contact.NONE and not d.at_fault for d in drives)
    return {"drives": len(drives), "other_contacts": others}


COMFORT = {"acceleration_rms": "mps2", "jerk_rms": "mps3", "lateral_rms": "mps2", "braking_p99": "mps2"}


def _changes(drive: Drive, whose: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Acceleration, jerk and lateral acceleration of one drive, by the same differences for everybody."""
    speed, path = getattr(drive, f"{whose}speed"), getattr(drive, f"{whose}path")
    change = np.diff(speed) / drive.period
    lateral = speed[1:] * np.diff(np.unwrap(path[:, 2])) / drive.period
    return change, np.diff(change) / drive.period, lateral


def _root_mean_square(parts: Sequence[np.ndarray]) -> Callable[[np.ndarray], float]:
    """Over all steps of the drives that are drawn."""
    squares, sizes = np.array([(x**2).sum() for x in parts]), np.array([len(x) for x in parts])
    return lambda index: float(np.sqrt(squares[index].sum() / sizes[index].sum()))


def _percentile(parts: Sequence[np.ndarray]) -> Callable[[np.ndarray], float]:
    return lambda index: float(np.percentile(np.concatenate([parts[i] for i in index]), 99))


def table(drives: Sequence[Drive]) -> dict[str, list[Any]]:
    """One row per scene and one for all."""
    rows = {name: score(part) for name, part in scenes_of(drives).items()}
    counted = [counts(part) for part in scenes_of(drives).values()]

    def pair(name: str) -> list[str]:
        return [f"{row[name].value:.2f} / {row[f'human_{name}'].value:.2f}" for row in rows.values()]

    def column(name: str) -> list[str]:
        return [row[name].text() for row in rows.values()]

    return {
        "scene": list(rows),
        "drives": [row["drives"] for row in counted],
        "no at-fault collision [%]": column("no_at_fault_collision_percent"),
        "other contacts": [row["other_contacts"] for row in counted],
        "off the road [%]": column("off_road_percent"),
        "progress of the human's [%]": column("progress_percent"),
        "median": column("progress_median_percent"),
        "mean, capped at 100": column("progress_capped_percent"),
        "acceleration RMS, ours / human [m/s2]": pair("acceleration_rms_mps2"),
        "jerk RMS [m/s3]": pair("jerk_rms_mps3"),
        "lateral RMS [m/s2]": pair("lateral_rms_mps2"),
    }


def problems(drives: Sequence[Drive]) -> dict[str, list[Any]]:
    """One row per planning problem."""
    return {
        "scenario": [d.scene for d in drives],
        "drive": [d.name for d in drives],
        "duration [s]": [(len(d.speed) - 1) * d.period for d in drives],
        "collision at fault": [d.at_fault for d in drives],
        "off the road": [d.off_road for d in drives],
        "goal reached": [d.reached for d in drives],
        "progress [m]": [d.way for d in drives],
        "mean speed [m/s]": [float(d.speed.mean()) for d in drives],
    }


def problem_score(drives: Sequence[Drive]) -> dict[str, float]:
    """Shares of the planning problems with their Wilson intervals: name with unit to value."""
    return {
        "problems": float(len(drives)),
        **statistics.rate([not d.at_fault for d in drives]).percent.flat("no_at_fault_collision_percent"),
        **statistics.rate([d.off_road for d in drives]).percent.flat("off_road_percent"),
        **statistics.rate([bool(d.reached) for d in drives]).percent.flat("goal_reached_percent"),
    }


def failures(drives: Sequence[Drive], left_out: dict[str, dict[str, str]]) -> dict[str, list[str]]:
    """Every drive with a contact or off the road, and every vehicle left out, with the reason."""
    rows = [
        (d.scene, d.name, "at fault" if d.at_fault else "not at fault", d.failure or _contact(d))
        for d in drives
        if d.contact != Contact.NONE
    ]
    rows += [(d.scene, d.name, "off the road", "a corner left all lanes") for d in drives if d.off_road]
    rows += [(scene, name, "left out", why) for scene, vehicles in left_out.items() for name, why in vehicles.items()]
    return {name: [row[i] for row in rows] for i, name in enumerate(("scene", "vehicle", "what", "why"))}


def _contact(drive: Drive) -> str:
    return f"{drive.contact.name.lower()} contact with {drive.contact_with} after {drive.contact_time:.1f} s"


def rows(drives: Sequence[Drive]) -> dict[str, list[Any]]:
    """One row per drive."""
    return {
        "scene": [d.scene for d in drives],
        "vehicle": [d.name for d in drives],
        "duration_s": [(len(d.speed) - 1) * d.period for d in drives],
        "contact": [d.contact.name for d in drives],
        "at_fault": [d.at_fault for d in drives],
        "off_road": [d.off_road for d in drives],
        "progress_m": [d.way for d in drives],
        "human_progress_m": [d.human_way for d in drives],
        "mean_speed_mps": [float(d.speed.mean()) for d in drives],
        "human_mean_speed_mps": [float(np.mean(d.human_speed)) if len(d.human_speed) else None for d in drives],
    }
