"""What the rows of an evaluation amount to; every number over drives with its interval."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from urbanjax.evaluation import statistics
from urbanjax.evaluation.missions import MISSIONS
from urbanjax.evaluation.missions.mission import ROADS
from urbanjax.evaluation.statistics import WithInterval
from urbanjax.evaluation.verdict import Cause
from urbanjax.types import ConfigError

Rows = list[dict[str, Any]]
KEY = ("driver", "traffic", "mission", "seed")
SCORES = {
    "nuplan_total": "nuPlan score",
    "carla_total": "CARLA driving score",
    "competition_total": "competition [s]",
}
SUBSCORES = (
    "nuplan_no_collision_at_fault",
    "nuplan_drivable_area",
    "nuplan_driving_direction",
    "nuplan_making_progress",
    "nuplan_ttc_within_bound",
    "nuplan_progress",
    "nuplan_speed_limit",
    "nuplan_comfort",
)


def chosen(rows: Rows, **values: Any) -> Rows:
    """The rows that hold these values."""
    return [row for row in rows if all(row[name] == value for name, value in values.items())]


def names(rows: Rows, column: str) -> list[str]:
    """What a column holds, in the order of the rows."""
    return list(dict.fromkeys(row[column] for row in rows))


def scenes(rows: Rows) -> np.ndarray:
    """The road or the recording of each drive: drives of one depend on each other."""
    return np.array([f"{row['mission']} {row['seed'] % ROADS if row['mission'] in MISSIONS else ''}" for row in rows])


def success(rows: Rows) -> WithInterval:
    """Share of drives that reached their goal in time without a violation."""
    return statistics.rate([row["success"] for row in rows])


def mean(rows: Rows, column: str) -> WithInterval:
    """Mean of a column, whole roads drawn."""
    return statistics.mean([row[column] for row in rows], groups=scenes(rows))


def headline(rows: Rows) -> dict[str, list[Any]]:
    """One line for each driver and traffic, pooled over the missions."""
    out: dict[str, list[Any]] = {}
    for driver, traffic in _pairs(rows):
        part = chosen(rows, driver=driver, traffic=traffic)
        line = {"driver": driver, "traffic": traffic, "drives": len(part)}
        line |= {"success [%]": success(part).percent.text(), "reached [%]": _share(part, "competition_reached")}
        line |= {
            "at-fault collision [%]": _share(part, "competition_at_fault"),
            "off the road [%]": _share(part, "competition_off_road"),
        }
        line |= {title: mean(part, column).text(2) for column, title in SCORES.items()}
        _append(out, line)
    return out


def by_mission(rows: Rows) -> dict[str, list[Any]]:
    """Success and nuPlan score of each driver in each mission."""
    out: dict[str, list[Any]] = {}
    for driver, traffic in _pairs(rows):
        for mission in names(rows, "mission"):
            part = chosen(rows, driver=driver, traffic=traffic, mission=mission)
            _append(
                out,
                {
                    "mission": mission,
                    "driver": driver,
                    "traffic": traffic,
                    "drives": len(part),
                    "success [%]": success(part).percent.text(),
                    "nuPlan score": mean(part, "nuplan_total").text(2),
                    "time [s]": mean(part, "competition_time").text(1),
                    "commonest causes of failure": causes(part, 2),
                },
            )
    return out


def causes(rows: Rows, count: int = 5) -> str:
    """The commonest causes of failure by name, with their numbers."""
    found = [row["cause"] for row in rows if not row["success"]]
    tally = sorted({name: found.count(name) for name in found}.items(), key=lambda pair: (-pair[1], pair[0]))
    return ", ".join(f"{name} {number}" for name, number in tally[:count]) or "-"


def failures(rows: Rows) -> dict[str, list[Any]]:
    """How often each cause ended a driver's drive."""
    out: dict[str, list[Any]] = {}
    for driver, traffic in _pairs(rows):
        part = chosen(rows, driver=driver, traffic=traffic)
        counts = {cause.label: sum(row["cause"] == cause.label for row in part) for cause in Cause if cause}
        _append(out, {"driver": driver, "traffic": traffic, **counts})
    return out


def subscores(rows: Rows) -> dict[str, list[Any]]:
    """Means of nuPlan's sub-scores, raw."""
    out: dict[str, list[Any]] = {}
    for driver, traffic in _pairs(rows):
        part = chosen(rows, driver=driver, traffic=traffic)
        columns = {name.removeprefix("nuplan_").replace("_", " "): mean(part, name).text(2) for name in SUBSCORES}
        _append(out, {"driver": driver, "traffic": traffic, **columns})
    return out


def differences(rows: Rows) -> dict[str, list[Any]]:
    """Each driver against the first one, drive by drive from the same starts."""
    out: dict[str, list[Any]] = {}
    for traffic in names(rows, "traffic"):
        first, *others = names(rows, "driver")
        for other in others:
            _append(
                out,
                {
                    "traffic": traffic,
                    "drivers": f"{first} - {other}",
                    **against(chosen(rows, driver=first, traffic=traffic), chosen(rows, driver=other, traffic=traffic)),
                },
            )
    return out


def against(ours: Rows, theirs: Rows) -> dict[str, Any]:
    """Paired differences of two sets of drives from the same starts, for a line of a table."""
    pairs = {(row["mission"], row["seed"]): row for row in theirs}
    both = [row for row in ours if (row["mission"], row["seed"]) in pairs]
    if not both:
        raise ConfigError("the two have no start in common: compare runs of the same missions and seeds")
    other = [pairs[row["mission"], row["seed"]] for row in both]
    line: dict[str, Any] = {"pairs": len(both)}
    for column, title, scale in (("success", "success [points]", 100.0), ("nuplan_total", "nuPlan score", 1.0)):
        one, two = ([scale * float(row[column]) for row in part] for part in (both, other))
        line[title] = statistics.paired(one, two, groups=scenes(both)).text(1 if scale > 1 else 3)
    return line


def summary(rows: Rows) -> dict[str, Any]:
    """Flat numbers: per driver and traffic pooled, and per mission."""
    out: dict[str, Any] = {"drives": len(rows)}
    for driver, traffic in _pairs(rows):
        for mission in ("", *names(rows, "mission")):
            part = chosen(rows, driver=driver, traffic=traffic, **({"mission": mission} if mission else {}))
            name = "_".join(x for x in (driver, traffic, mission) if x)
            out |= success(part).flat(f"{name}_success_share")
            out |= mean(part, "nuplan_total").flat(f"{name}_nuplan_score")
    return out


def coverage(rows: Rows, expected: Iterable[tuple]) -> dict[str, list[Any]]:
    """Drives that were to be done, are there, are there twice, and are missing."""
    wanted = list(expected)
    found = [tuple(row[name] for name in KEY) for row in rows]
    missing = sorted(set(wanted) - set(found))
    return {
        "expected": [len(wanted)],
        "found": [len(set(found))],
        "duplicates": [len(found) - len(set(found))],
        "missing": [", ".join(map(str, missing[:5])) or "-"],
        "not finite": [sum(not np.isfinite(row["nuplan_total"]) for row in rows)],
    }


def worst(rows: Rows, driver: str, count: int) -> Rows:
    """The drives of a driver that failed with the lowest nuPlan score, of every mission in turn."""
    failed = sorted(
        (row for row in rows if row["driver"] == driver and not row["success"]), key=lambda row: row["nuplan_total"]
    )
    turn: dict[str, int] = {}
    order = []
    for row in failed:
        turn[row["mission"]] = turn.get(row["mission"], 0) + 1
        order.append((turn[row["mission"]], len(order), row))
    return [row for _, _, row in sorted(order, key=lambda entry: entry[:2])[:count]]


def _share(rows: Rows, column: str) -> str:
    return statistics.rate([row[column] for row in rows]).percent.text()


def _pairs(rows: Rows) -> list[tuple[str, str]]:
    return list(dict.fromkeys((row["driver"], row["traffic"]) for row in rows))


def _append(out: dict[str, list[Any]], line: dict[str, Any]) -> None:
    for name, value in line.items():
        out.setdefault(name, []).append(value)


def columns(rows: Rows) -> dict[str, Sequence[Any]]:
    """The rows as columns, for the table on disk."""
    return {name: [row[name] for row in rows] for name in rows[0]}
