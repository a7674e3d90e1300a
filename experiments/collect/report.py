"""The table and the report of sweeps, into a run of their own or into the directory of the sweep."""

import functools
from collections.abc import Sequence
from pathlib import Path

from experiments.collect import sections, tables, times
from experiments.collect.axes import axes_of
from experiments.collect.best import write_best
from experiments.collect.collected import Collected, collected
from experiments.collect.study import CollectStudy
from experiments.collect.sweeps import (
    SweepCoverage,
    SweepJob,
    SweepPlan,
    coverage,
    jobs_of,
    plan_of,
    sweeps_in,
    unique,
)
from urbanjax.io.runs import progress, report
from urbanjax.io.runs.directory import COMPLETE, FAILED, Run

SHOWN = 5  # jobs in the terminal


def write(params: CollectStudy, run: Run) -> None:
    """Read all sweeps, write table, figures, best values and report into the run, and print the best jobs."""
    _write(params, run, sweeps_in(params.dirs), "Sweeps")


def write_sweep(folder: Path) -> SweepCoverage:
    """How many jobs of a sweep there are; writes its table, report and best values into its own directory.

    What was there of these is replaced. Its manifest is complete where every job is. Args: folder of the sweep. Raises
    FileError where its plan cannot be read.
    """
    plan = plan_of(folder)
    seed = plan.config.get("seed")
    run = Run(folder, plan.config, seed if isinstance(seed, int) else None, again=True)
    found = _write(CollectStudy(), run, [plan], f"Sweep {plan.name} of {plan.experiment}")
    run.finish(COMPLETE if found.whole else FAILED, None if found.whole else found.text)
    return found


def _write(params: CollectStudy, run: Run, plans: Sequence[SweepPlan], title: str) -> SweepCoverage:
    planned = [job for plan in plans for job in jobs_of(plan)]
    jobs, duplicates = unique(planned)
    counted = coverage(jobs, duplicates)
    parts = _parts(params, plans, jobs)
    keys = dict.fromkeys(axis.key for part in parts for axis in part.axes)
    table = tables.jobs_table(jobs, list(keys))
    run.table("table", table)
    run.summary({name: getattr(counted, name) for name in ("expected", "complete", "failed", "missing", "duplicates")})
    shown = [section for part in parts for section in sections.of_part(part, run)]
    for part in parts:
        _best(part, run)
    shown += sections.of_all(jobs, duplicates, counted, table, parts)
    facts = functools.partial(times.facts, jobs=jobs)
    report.write_report(run.path("report.html"), title, sections=shown, manifest=run.manifest(COMPLETE), facts=facts)
    for part in parts:
        columns = tables.best_jobs(part.ranking[:SHOWN], part.axes, part.evidence, part.scores)
        if part.ranking:
            progress.show_table(f"best jobs of {part.experiment}", columns)
    print(counted.text, flush=True)
    return counted


def _parts(params: CollectStudy, plans: Sequence[SweepPlan], jobs: Sequence[SweepJob]) -> list[Collected]:
    """What there is of each experiment: jobs of two are not compared."""
    names = list(dict.fromkeys(plan.experiment for plan in plans))
    out = []
    for name in names:
        theirs = [plan for plan in plans if plan.experiment == name]
        part = [job for job in jobs if job.experiment == name]
        out.append(collected(params, theirs, part, axes_of(theirs, part), alone=len(names) == 1))
    return out


def _best(part: Collected, run: Run) -> None:
    """The parameter file of the best job, and its score in the summary."""
    if not part.ranking:
        return
    best, score = part.ranking[0], part.scores[0]
    found = part.evidence.of(best, score.name)
    run.summary(found.flat(f"{part.prefix}best_{score.name}"))
    told = [f"{each.name} {tables.text(part.evidence.of(best, each.name))}" for each in part.scores]
    plan = next(plan for plan in part.plans if plan.name == best.sweep)
    write_best(run.path(f"{part.prefix}best.yaml"), best, scores=told, plan=plan)
