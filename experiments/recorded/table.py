"""What the drives among recorded traffic amount to."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from urbanjax.evaluation.collisions import Contact
from urbanjax.evaluation.recorded.drive import Drive

ALL = "all"
AT_LEAST = 1.0  # m, a recorded drive of less has no ratio


def scenes_of(drives: Sequence[Drive]) -> dict[str, list[Drive]]:
    """The drives of each scene, and of all of them."""
    names = list(dict.fromkeys(drive.scene for drive in drives))
    return {name: [d for d in drives if d.scene == name] for name in names} | {ALL: list(drives)}


def score(drives: Sequence[Drive]) -> dict[str, float]:
    """Shares, progress and comfort of some drives: name with unit to value."""
    way, human = (np.array([getattr(d, name) for d in drives]) for name in ("way", "human_way"))
    moved = human > AT_LEAST
    ratio = way[moved] / human[moved]
    ours, theirs = (_comfort(drives, whose) for whose in ("", "human_"))
    return {
        "drives": float(len(drives)),
        "no_at_fault_collision_percent": 100 * float(np.mean([not d.at_fault for d in drives])),
        "other_contacts": float(sum(d.contact != Contact.NONE and not d.at_fault for d in drives)),
        "off_road_percent": 100 * float(np.mean([d.off_road for d in drives])),
        "progress_percent": 100 * float(way.sum() / human.sum()),
        "progress_median_percent": 100 * float(np.median(ratio)) if moved.any() else float("nan"),
        "progress_capped_percent": 100 * float(np.minimum(ratio, 1).mean()) if moved.any() else float("nan"),
        **{f"{name}_{unit}": ours[name] for name, unit in COMFORT.items()},
        **{f"human_{name}_{unit}": theirs[name] for name, unit in COMFORT.items()},
    }


COMFORT = {"acceleration_rms": "mps2", "jerk_rms": "mps3", "lateral_rms": "mps2", "braking_p99": "mps2"}


def _comfort(drives: Sequence[Drive], whose: str) -> dict[str, float]:
    """Root mean squares over all steps, by the same differences of speed and heading for everybody."""
    acceleration, jerk, lateral = [], [], []
    for drive in drives:
        speed, path = getattr(drive, f"{whose}speed"), getattr(drive, f"{whose}path")
        change = np.diff(speed) / drive.period
        acceleration.append(change)
        jerk.append(np.diff(change) / drive.period)
        lateral.append(speed[1:] * np.diff(np.unwrap(path[:, 2])) / drive.period)
    a, j, b = (np.concatenate(x) for x in (acceleration, jerk, lateral))
    root = (float(np.sqrt(np.mean(x**2))) for x in (a, j, b))
    return dict(zip(COMFORT, (*root, float(np.percentile(-a, 99))), strict=True))


def table(drives: Sequence[Drive]) -> dict[str, list[Any]]:
    """One row per scene and one for all."""
    rows = {name: score(part) for name, part in scenes_of(drives).items()}

    def pair(name: str) -> list[str]:
        return [f"{row[name]:.2f} / {row[f'human_{name}']:.2f}" for row in rows.values()]

    def column(name: str) -> list[Any]:
        return [row[name] for row in rows.values()]

    return {
        "scene": list(rows),
        "drives": [int(n) for n in column("drives")],
        "no at-fault collision [%]": column("no_at_fault_collision_percent"),
        "other contacts": [int(n) for n in column("other_contacts")],
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
    """Shares of the planning problems: name with unit to value."""
    return {
        "problems": float(len(drives)),
        "no_at_fault_collision_percent": 100 * float(np.mean([not d.at_fault for d in drives])),
        "off_road_percent": 100 * float(np.mean([d.off_road for d in drives])),
        "goal_reached_percent": 100 * float(np.mean([bool(d.reached) for d in drives])),
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
