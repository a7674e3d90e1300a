"""Drive, keep the rows as they come, and say what they amount to."""

import resource
from typing import Any

from experiments.common import recordings
from experiments.evaluate import driving, figures, replay, study, tables
from experiments.evaluate.study import Asked, EvaluateStudy
from experiments.evaluate.tables import KEY, Rows
from urbanjax.evaluation.batch import Job, Outcome, case_of, outcomes
from urbanjax.evaluation.missions.recorded import RecordedMission
from urbanjax.io.figures.animation import write_gif
from urbanjax.io.runs import progress, report
from urbanjax.io.runs.directory import Run
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.sim.log import Log
from urbanjax.types import ConfigError
from urbanjax.vehicle.params import VehicleParams

EVERY = 2  # steps between the pictures of a GIF
PEAK = 1024.0  # kB in a MB

SUCCESS = (
    "Success: the goal reached within the time limit without a collision at fault (nuPlan's rule), without leaving the "
    "road, running a red signal, driving in an oncoming lane that is not for overtaking, or speeding by 1 m/s. Drives "
    "that fail count; none is dropped. "
    "Brackets: 95 % intervals, of shares Wilson's, of means and paired differences from drawing whole roads."
)
SIGNALS = "Signals show what the map's program says at the time of the record, and green where the map states none."

LOCALIZATION = (
    "Where drivers find their pose from scans: times are means over drives; wrong is an error above half a metre"
)
ORDERS = (
    'Who is better by each score: ">" where the interval of the paired difference is clear of 0, "~" where it is not'
)


def write(params: EvaluateStudy, run: Run) -> None:
    """Drive all, write rows, tables, figures and report; or compare two runs, or drive one row again."""
    if params.replay and (params.run or params.against):
        raise ConfigError("'replay' drives a row again, 'run' and 'against' compare two runs: set one or the other")
    if params.replay:
        replay.write(params, run)
        return
    if bool(params.run) != bool(params.against):
        raise ConfigError("'run' and 'against' belong together: name two directories of evaluations")
    if params.run:
        _compare(params, run)
        return
    driven = driving.MissionDrives(params, run)
    asked = driven.asked
    rows, count, seconds = driving.drive(driven)
    if params.process:
        return  # process 0 goes on with the rows of all
    found = driving.write_tables(driven, rows)
    if run.swept:
        return
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / PEAK
    run.summary({"run_s": seconds, "drives_per_s": count / seconds, "peak_memory_mb": peak})
    scenes = [one.scene for one in asked.values() if isinstance(one, RecordedMission)]
    signals = recordings.signals(scenes) if scenes else {}
    if signals:
        run.table("signals", signals)
    progress.show_table("evaluation", found["headline"])
    if found["differences"]:
        progress.show_table("paired differences", found["differences"])
    figures.draw_success(rows, run.path("success.png"))
    shown = [report.Picture("Success and nuPlan score by mission", run.path("success.png"))]
    if len(params.traffic) > 1:
        figures.draw_matrix(rows, run.path("matrix.png"))
        shown.append(report.Picture("Drivers against kinds of traffic", run.path("matrix.png")))
    sections = [
        report.Section(
            "What came out",
            [],
            [
                report.Table(SUCCESS, found["headline"]),
                *(
                    [report.Table("Paired differences from the same starts", found["differences"])]
                    if found["differences"]
                    else []
                ),
                report.Table(ORDERS, found["orders"]),
                *([report.Table(LOCALIZATION, found["localizations"])] if found["localizations"] else []),
                *shown,
            ],
        ),
        report.Section("By mission", [], [report.Table(SUCCESS, found["missions"]), _gallery(params, run, asked)]),
        report.Section(
            "Why drives failed", [], [report.Table("First violation, or what kept it from the goal", found["causes"])]
        ),
        report.Section(
            "What the scores are made of",
            [],
            [
                report.Table(f"{title}: means before its gates", found[score])
                for score, (title, _) in tables.scores(rows).items()
            ],
        ),
        report.Section("Coverage", [], [report.Table(", ".join(KEY), found["coverage"])]),
        *([report.Section("Recordings", [], [report.Table(SIGNALS, signals)])] if scenes else []),
        *_worst(params, run, rows, asked),
    ]
    report.write_report(run.path("report.html"), "Evaluation", sections=sections, manifest=run.manifest("complete"))


def _gallery(params: EvaluateStudy, run: Run, asked: Asked) -> report.Picture:
    """One drive of each mission by the first driver."""
    driver, traffic = params.drivers[0], next(x for x in params.traffic if study.jobs_of(params, asked, x))
    jobs = list({job.mission.name: job for job in reversed(study.jobs_of(params, asked, traffic))}.values())[::-1]
    drives = [
        (
            f"{one.job.mission.name}: {driving.label(int(one.row['cause']))}",
            *_log_and_road(params, driver, traffic, one),
            not one.row["success"],
        )
        for one in outcomes(study.loop_of(params, driver), jobs, traffic=traffic, logs=True)
    ]
    figures.draw_gallery(drives, run.path("missions.png"))
    caption = f"One drive of each mission by {driver}, seed {params.seed}; red where it failed"
    return report.Picture(caption, run.path("missions.png"))


def _worst(params: EvaluateStudy, run: Run, rows: Rows, asked: Asked) -> list[report.Section]:
    """Moving pictures of the first driver's worst drives."""
    driver, traffic = params.drivers[0], rows[0]["traffic"]
    chosen = tables.worst(tables.chosen(rows, traffic=traffic), driver, params.worst)
    if not chosen:
        return []
    jobs = [Job(asked[row["mission"]], row["seed"]) for row in chosen]
    items: list[report.Table | report.Picture] = []
    drives = outcomes(study.loop_of(params, driver), jobs, traffic=traffic, logs=True)
    for row, one in zip(chosen, drives, strict=True):
        log, graph, vehicle = _log_and_road(params, driver, traffic, one)
        name = f"worst_{row['mission']}_{row['seed']}.gif"
        title = f"{row['mission']}, seed {row['seed']}: {row['cause']} at {row['cause_time_s']:.1f} s"
        frames = figures.moving(log, graph, vehicle, every=EVERY, title=title)
        write_gif(run.path(name), frames, rate=1.0 / (EVERY * float(params.period)))
        items.append(report.Picture(title, run.path(name)))
    return [report.Section(f"Worst drives of {driver}", [], items)]


def _log_and_road(
    params: EvaluateStudy, driver: str, traffic: str, outcome: Outcome
) -> tuple[Log, RoadGraph, VehicleParams]:
    case = case_of(study.loop_of(params, driver), outcome.job, traffic=traffic)
    return study.until_end(outcome, case, params.vehicle)


def _compare(params: EvaluateStudy, run: Run) -> None:
    """Two runs, drive by drive."""
    ours, theirs = (study.rows_of(getattr(params, key), key) for key in ("run", "against"))
    found: dict[str, list[Any]] = {}
    for driver in dict.fromkeys((*tables.names(ours, "driver"), *tables.names(theirs, "driver"))):
        for told in tables.settings(ours):
            pair = [tables.chosen(rows, driver=driver, **told) for rows in (ours, theirs)]
            if all(pair):
                line = {"driver": driver, **told, **tables.against(*pair)}
                for name, value in line.items():
                    found.setdefault(name, []).append(value)
    if not found:
        raise ConfigError(f"run={params.run} and against={params.against} have no driver and traffic in common")
    run.table("differences", found)
    run.summary({"lines": len(found["driver"]), "pairs": sum(found["pairs"])})
    progress.show_table(f"{params.run} less {params.against}", found)
    items = [report.Table("Paired differences from the same starts", found)]
    section = report.Section(f"{run.config.get('run', 'one')} less {run.config.get('against', 'other')}", [], items)
    report.write_report(run.path("report.html"), "Two runs", sections=[section], manifest=run.manifest("complete"))
