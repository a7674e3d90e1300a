"""What the rows of an evaluation amount to; every number over drives with its interval."""

import itertools
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from urbanjax.evaluation import statistics
from urbanjax.evaluation.missions import MISSIONS
from urbanjax.evaluation.missions.localized import GIVEN, LOCALIZATIONS
from urbanjax.evaluation.missions.mission import ROADS
from urbanjax.evaluation.statistics import WithInterval
from urbanjax.evaluation.verdict import Cause
from urbanjax.types import ConfigError

Rows = list[dict[str, Any]]
KEY = ("driver", "traffic", "mission", "seed")
SCORES = {  # the title of each, and whether more is better
    "nuplan": ("nuPlan score", True),
    "epdms_driven": ("EPDMS, driven", True),
    "carla": ("CARLA driving score", True),
    "commonroad": ("CommonRoad cost", False),
    "competition": ("competition [s]", False),
}
WHEREABOUTS = {  # columns of drives on scans
    "mean error [m]": "localization_mean_error_m",
    "not normal [s]": "localization_not_normal_s",
    "stopped, lost [s]": "localization_stopped_s",
}
UNNOTICED = 1.0  # s, for which nobody may be wrong without knowing
NOT_PARTS = ("_total", "_success", "_gate", "_defined", "_windows", "_reference", "_way", "_least_ttc")


def chosen(rows: Rows, **values: Any) -> Rows:
    """The rows that hold these values."""
    return [row for row in rows if all(row[name] == value for name, value in values.items())]


def names(rows: Rows, column: str) -> list[str]:
    """What a column holds, in the order of the rows."""
    return list(dict.fromkeys(row[column] for row in rows))


def scenes(rows: Rows) -> np.ndarray:
    """The road or the recording of each drive: drives of one depend on each other."""
    named = [(drawn(row["mission"])[0], row) for row in rows]
    return np.array([f"{mission} {row['seed'] % ROADS}" if mission else row["mission"] for mission, row in named])


def drawn(name: str) -> tuple[str, str]:
    """The mission that draws its roads and how drivers know where they are on them, from the name of what is driven.

    Both are empty for a recording.
    """
    for how in ("", *(f"_{how}" for how in LOCALIZATIONS)):
        if name.endswith(how) and (mission := name.removesuffix(how)) in MISSIONS:
            return mission, how[1:] or GIVEN
    return "", ""


def scores(rows: Rows) -> dict[str, tuple[str, bool]]:
    """The scores that the rows hold, see SCORES."""
    return {score: told for score, told in SCORES.items() if f"{score}_total" in rows[0]}


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
        line |= {title: mean(part, f"{score}_total").text(2) for score, (title, _) in scores(rows).items()}
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


def parts(rows: Rows, score: str) -> dict[str, list[Any]]:
    """Means of what a score is made of, before its gates. Args: score, one of SCORES."""
    told = [name for name in rows[0] if name.startswith(f"{score}_") and not name.endswith(NOT_PARTS)]
    told = [name for name in told if not name.startswith(f"{score}_gated_")]
    out: dict[str, list[Any]] = {}
    for driver, traffic in _pairs(rows):
        part = chosen(rows, driver=driver, traffic=traffic)
        columns = {name.removeprefix(f"{score}_").replace("_", " "): mean(part, name).text(2) for name in told}
        _append(out, {"driver": driver, "traffic": traffic, **columns})
    return out


def orders(rows: Rows) -> dict[str, list[Any]]:
    """The drivers from best to worst by success and by each score, "~" where the next one is not clearly worse."""
    out: dict[str, list[Any]] = {}
    judged = {"success": ("success", True)}
    judged |= {f"{score}_total": told for score, told in scores(rows).items()}
    for traffic in names(rows, "traffic"):
        by_driver = {name: chosen(rows, traffic=traffic, driver=name) for name in names(rows, "driver")}
        by_driver = {name: part for name, part in by_driver.items() if part}
        for column, (title, more) in judged.items():
            sign = 1.0 if more else -1.0
            best = sorted(by_driver, key=lambda name: -sign * mean(by_driver[name], column).value)
            text = best[0]
            for one, other in itertools.pairwise(best):
                found = _paired(by_driver[one], by_driver[other], column)
                clear = min(sign * found.low, sign * found.high) > 0
                text += f" {'>' if clear else '~'} {other}"
            _append(out, {"traffic": traffic, "by": title, "from best to worst": text})
    return out


def localizations(rows: Rows) -> dict[str, list[Any]]:
    """What it costs to find one's pose, and that this fails: against the first kind asked for, from the same starts."""
    kinds = list(dict.fromkeys(how for row in rows if (how := drawn(row["mission"])[1])))
    out: dict[str, list[Any]] = {}
    for driver, traffic in _pairs(rows):
        some = {
            how: [
                {**row, "mission": mission}
                for row in chosen(rows, driver=driver, traffic=traffic)
                if (mission := drawn(row["mission"])[0]) and drawn(row["mission"])[1] == how
            ]
            for how in kinds
        }
        for how, part in some.items():
            line = {"driver": driver, "traffic": traffic, "localization": how, "drives": len(part)}
            line |= {"success [%]": success(part).percent.text(), "nuPlan score": mean(part, "nuplan_total").text(2)}
            for title, column in WHEREABOUTS.items():
                line[title] = mean(part, column).text(2) if part[0].get(column) is not None else "-"
            lost = [(row.get("localization_unnoticed_s") or 0.0) > UNNOTICED for row in part]
            line[f"wrong for {UNNOTICED:g} s while normal [%]"] = statistics.rate(lost).percent.text()
            both = against(part, some[kinds[0]]) if how != kinds[0] else {}
            _append(out, line | {f"success less {kinds[0]} [points]": both.get("success [points]", "-")})
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
    both, other = _pairwise(ours, theirs)
    line: dict[str, Any] = {"pairs": len(both)}
    line["success [points]"] = _paired(both, other, "success").percent.text()
    line["nuPlan score"] = _paired(both, other, "nuplan_total").text(3)
    return line


def _pairwise(ours: Rows, theirs: Rows) -> tuple[Rows, Rows]:
    pairs = {(row["mission"], row["seed"]): row for row in theirs}
    both = [row for row in ours if (row["mission"], row["seed"]) in pairs]
    if not both:
        raise ConfigError("the two have no start in common: compare runs of the same missions and seeds")
    return both, [pairs[row["mission"], row["seed"]] for row in both]


def _paired(ours: Rows, theirs: Rows, column: str) -> WithInterval:
    both, other = _pairwise(ours, theirs)
    one, two = ([float(row[column]) for row in part] for part in (both, other))
    return statistics.paired(one, two, groups=scenes(both))


def summary(rows: Rows) -> dict[str, Any]:
    """Flat numbers: per driver and traffic pooled, and per mission."""
    out: dict[str, Any] = {"drives": len(rows)}
    for driver, traffic in _pairs(rows):
        for mission in ("", *names(rows, "mission")):
            part = chosen(rows, driver=driver, traffic=traffic, **({"mission": mission} if mission else {}))
            name = "_".join(x for x in (driver, traffic, mission) if x)
            out |= success(part).flat(f"{name}_success_share")
            for score in scores(rows) if not mission else ("nuplan",):
                out |= mean(part, f"{score}_total").flat(f"{name}_{score}_score")
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
    names = list(dict.fromkeys(name for row in rows for name in row))
    return {name: [row.get(name) for row in rows] for name in names}
