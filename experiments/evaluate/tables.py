"""What the rows of an evaluation amount to; every number over drives with its interval."""

import itertools
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from experiments.common.scenes import base, scenes
from urbanjax.evaluation import statistics
from urbanjax.evaluation.missions.localized import GIVEN
from urbanjax.evaluation.statistics import WithInterval
from urbanjax.evaluation.verdict import Cause
from urbanjax.evaluation.whereabouts import LONG
from urbanjax.types import ConfigError

Rows = list[dict[str, Any]]
GROUP = ("driver", "traffic", "localization")
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
NOT_PARTS = ("_total", "_success", "_gate", "_defined", "_windows", "_reference", "_way", "_least_ttc")


def chosen(rows: Rows, **values: Any) -> Rows:
    """The rows that hold these values."""
    return [row for row in rows if all(row[name] == value for name, value in values.items())]


def names(rows: Rows, column: str) -> list[str]:
    """What a column holds, in the order of the rows."""
    return list(dict.fromkeys(row[column] for row in rows))


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
    """One line for each driver, traffic and localization, pooled over the missions."""
    out: dict[str, list[Any]] = {}
    for group in _groups(rows):
        part = chosen(rows, **group)
        line = {**group, "drives": len(part)}
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
    for group in _groups(rows):
        for mission in names(chosen(rows, **group), "mission"):
            part = chosen(rows, **group, mission=mission)
            _append(
                out,
                {
                    "mission": mission,
                    **group,
                    "drives": len(part),
                    "success [%]": success(part).percent.text(),
                    "nuPlan score": mean(part, "nuplan_total").text(2),
                    "time [s]": mean(part, "competition_time").text(1),
                    "commonest causes of failure": causes(part, 5),
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
    for group in _groups(rows):
        part = chosen(rows, **group)
        counts = {cause.label: sum(row["cause"] == cause.label for row in part) for cause in Cause if cause}
        _append(out, {**group, **counts})
    return out


def parts(rows: Rows, score: str) -> dict[str, list[Any]]:
    """Means of what a score is made of, before its gates. Args: score, one of SCORES."""
    told = [name for name in rows[0] if name.startswith(f"{score}_") and not name.endswith(NOT_PARTS)]
    told = [name for name in told if not name.startswith(f"{score}_gated_")]
    out: dict[str, list[Any]] = {}
    for group in _groups(rows):
        part = chosen(rows, **group)
        columns = {name.removeprefix(f"{score}_").replace("_", " "): mean(part, name).text(2) for name in told}
        _append(out, {**group, **columns})
    return out


def orders(rows: Rows) -> dict[str, list[Any]]:
    """The drivers from best to worst by success and by each score, "~" where the next one is not clearly worse."""
    out: dict[str, list[Any]] = {}
    judged = {"success": ("success", True)}
    judged |= {f"{score}_total": told for score, told in scores(rows).items()}
    for setting in settings(rows):
        by_driver = {name: chosen(rows, **setting, driver=name) for name in names(rows, "driver")}
        by_driver = {name: part for name, part in by_driver.items() if part}
        for column, (title, more) in judged.items():
            sign = 1.0 if more else -1.0
            best = sorted(by_driver, key=lambda name: -sign * mean(by_driver[name], column).value)
            text = best[0]
            for one, other in itertools.pairwise(best):
                found = _paired(by_driver[one], by_driver[other], column)
                clear = min(sign * found.low, sign * found.high) > 0
                text += f" {'>' if clear else '~'} {other}"
            _append(out, {**setting, "by": title, "from best to worst": text})
    return out


def localizations(rows: Rows) -> dict[str, list[Any]]:
    """What it costs to find one's pose, and that this fails: against the first kind asked for, from the same starts."""
    out: dict[str, list[Any]] = {}
    same = [{**row, "mission": base(row)} for row in rows]
    first, *_ = names(rows, "localization")
    for group in _groups(rows):
        part = chosen(same, **group)
        line = {**group, "drives": len(part), "success [%]": success(part).percent.text()}
        line["nuPlan score"] = mean(part, "nuplan_total").text(2)
        for title, column in WHEREABOUTS.items():
            line[title] = mean(part, column).text(2) if part[0].get(column) is not None else "-"
        unnoticed = [(row.get("localization_longest_unnoticed_s") or 0.0) > LONG for row in part]
        line[f"wrong for {LONG:g} s while normal [%]"] = statistics.rate(unnoticed).percent.text()
        plain = chosen(same, **{**group, "localization": first})
        line |= {
            f"{title}, less {first}": value if group["localization"] != first else "-"
            for title, value in against(part, plain).items()
            if title != "pairs"
        }
        _append(out, line)
    return out


def differences(rows: Rows) -> dict[str, list[Any]]:
    """Each driver against the first one, drive by drive from the same starts."""
    out: dict[str, list[Any]] = {}
    for setting in settings(rows):
        first, *others = names(rows, "driver")
        for other in others:
            pair = [chosen(rows, **setting, driver=name) for name in (first, other)]
            _append(out, {**setting, "drivers": f"{first} - {other}", **against(*pair)})
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
    for group in _groups(rows):
        how = group["localization"] if group["localization"] != GIVEN else ""
        for mission in ("", *names(chosen(rows, **group), "mission")):
            part = chosen(rows, **group, **({"mission": mission} if mission else {}))
            name = "_".join(x for x in (group["driver"], group["traffic"], mission or how) if x)
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


def settings(rows: Rows) -> list[dict[str, str]]:
    """In what drivers can be compared."""
    found = dict.fromkeys((row["traffic"], row["localization"]) for row in rows)
    return [{"traffic": traffic, "localization": how} for traffic, how in found]


def _groups(rows: Rows) -> list[dict[str, str]]:
    """What tells drives apart that are pooled over missions."""
    found = dict.fromkeys(tuple(row[name] for name in GROUP) for row in rows)
    return [dict(zip(GROUP, values, strict=True)) for values in found]


def _append(out: dict[str, list[Any]], line: dict[str, Any]) -> None:
    for name, value in line.items():
        out.setdefault(name, []).append(value)


def columns(rows: Rows) -> dict[str, Sequence[Any]]:
    """The rows as columns, for the table on disk."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    return {name: [row.get(name) for row in rows] for name in names}
