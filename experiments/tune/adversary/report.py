"""Numbers, found scenes, figures and report of the search for failures."""

from typing import Any

import numpy as np

from experiments.tune.adversary import figures, study
from experiments.tune.adversary.study import OURS, Quarry
from urbanjax.evaluation import road_users
from urbanjax.evaluation.batch import Outcome, case_of
from urbanjax.io.figures import drives
from urbanjax.io.runs import progress, report
from urbanjax.io.runs.directory import Run
from urbanjax.io.runs.found_file import write_found
from urbanjax.rollout import LoopParams
from urbanjax.tuning.adversary.arena import PARTS
from urbanjax.tuning.adversary.hunt import SEARCHES

CAPTION = (
    "Equal rollouts for each search: one with its gradient counts as many as measured in this run. A failure is a "
    "collision at the ego's fault by the competition's rule in a hard drive; avoidable, where full braking from some "
    "step since the other one began avoids it; distinct, in another cell of the space cut into "
    f"{PARTS} parts a number: both krigings are told of these cells, the other searches are not. Means over seeds with "
    "95 % bootstrap intervals."
)


def write(params: Any, run: Run) -> None:
    """Run all searches and write what they found. Args: params, of the study; run, its directory."""
    task, loop = params.adversary, params.loop()
    with progress.bar("adversary") as tick:
        quarries = study.pursue(loop, task, tick=tick)
        tick("confirming")
        items = _numbers(quarries, task, run)
        for driver in task.drivers:
            items += _found(study.loop_of(loop, driver), quarries, driver, task.drawn, run)
    figures.draw_counts(quarries, run.path("counts.png"), budget=task.budget)
    figures.draw_plane(quarries, run.path("plane.png"))
    items[1:1] = [
        report.Picture("Distinct avoidable failures over rollouts", run.path("counts.png")),
        report.Picture(
            "All that was tried, all searches; green rings, points with their gradient", run.path("plane.png")
        ),
    ]
    shown = report.Section("Failures by search", [], items)
    report.write_report(
        run.path("report.html"), "Failures found by gradient", sections=[shown], manifest=run.manifest("complete")
    )


def _numbers(quarries: list[Quarry], task: Any, run: Run) -> list[Any]:
    """The tables of counts and quotients, written into the run."""
    table = study.counted(quarries)
    run.table("failures", table)
    progress.show_table("failures", table)
    lines, summary = [], {}
    for driver in task.drivers:
        for ours, against in ((x, y) for x in OURS for y in list(SEARCHES)[list(SEARCHES).index(x) + 1 :]):
            found = study.ratio(quarries, driver, ours=ours, against=against)
            summary |= found.flat(f"{driver}_{ours}_times_{against}")
            lines.append({"driver": driver, "search": ours, "against": against, "times as many": found.text(2)})
        own = [one for one in quarries if one.driver == driver]
        summary[f"{driver}_unavoidable"] = sum(len(one.trials("unavoidable")) for one in own)
        summary[f"{driver}_gradient_cost_rollouts"] = float(np.mean([one.price for one in own]))
        for search in SEARCHES:
            summary[f"{driver}_{search}_distinct"] = sum(sum(one.counts(search)) for one in own)
    run.summary(summary)
    quotients = {name: [line[name] for line in lines] for name in lines[0]}
    run.table("quotients", quotients)
    progress.show_table("times as many", quotients)
    return [report.Table(CAPTION, table), report.Table("Times as many distinct failures", quotients)]


def _found(loop: LoopParams, quarries: list[Quarry], driver: str, drawn: int, run: Run) -> list[Any]:
    """The found scenes of a driver as a file, confirmed, the worst of them drawn."""
    found = study.scenes(quarries, driver)
    if not found:
        return [f"No avoidable failure of {driver} was found."]
    name = f"found_{driver}.json"
    write_found(run.path(name), found, about=f"encounters in which {driver} was found to fail though braking avoids it")
    driven = study.confirmed(loop, found)
    numbers = study.confirmation(driver, driven)
    run.summary(numbers)
    text = (
        f"{driver}: {numbers[f'{driver}_confirmed']} of {len(found)} found scenes fail in the evaluation too ({name})."
    )
    print(text)
    fails = [one for one in driven if one.row["competition_at_fault"]]
    worst = sorted(fails, key=_impact, reverse=True)[:drawn]
    return [text, *(_picture(loop, one, f"{driver}_{k}.png", run) for k, one in enumerate(worst))]


def _impact(one: Outcome) -> float:
    """The ego's speed [m/s] at the collision."""
    assert one.log is not None
    return float(np.interp(one.row["cause_time_s"], one.log.time, one.log.ego.speed))


def _picture(loop: LoopParams, one: Outcome, name: str, run: Run) -> report.Picture:
    case = case_of(loop, one.job, traffic="idm")
    drives.drive(road_users.until_end(one), case.lanes.graph, path=run.path(name), vehicle=loop.vehicle)
    when, speed = one.row["cause_time_s"], _impact(one)
    said = f"{one.row['mission']}, number {one.job.seed}: collision at {when:.1f} s, {speed:.1f} m/s"
    return report.Picture(said, run.path(name))
