"""The sections of the report: what was asked, what came out, and every figure with what it shows."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.collect import figures, figures_of_many, headline, responses, sensitivity, tables
from experiments.collect.axes import SweepAxis
from experiments.collect.collected import Collected
from experiments.collect.sweeps import SweepCoverage, SweepJob
from urbanjax.io.runs.directory import Run
from urbanjax.io.runs.report import Picture, Section, Table
from urbanjax.types import UrbanJaxError

ROWS = 200  # of the table of jobs in the page
MOST_PAIRS = 6  # heat maps
MOST_NAMES = 40  # bars of one figure
Items = list[Table | Picture | str]


def of_part(part: Collected, run: Run) -> list[Section]:
    """All that is said of one experiment. Args: part; run that the figures are written into."""
    suffix = f" ({part.experiment})" if part.prefix else ""
    found = {"What was asked": asked(part), "What came out": headline.came_out(part)}
    if part.known:
        found["Response to each axis"] = numbers(part, run)
        found["By name"] = names(part, run)
        found["Two axes at once"] = pairs(part, run)
        found["All axes at once"] = parallel(part, run)
        found["Two scores against each other"] = front(part, run)
        found["Which axis decides"] = deciding(part, run)
    return [Section(f"{title}{suffix}", [], items) for title, items in found.items() if items]


def asked(part: Collected) -> Items:
    """Sweeps and axes."""
    sweeps, axes = tables.asked(part.plans, part.axes)
    codes = {plan.code for plan in part.plans}
    items: Items = []
    if len(codes) > 1:
        items.append(f"The sweeps ran {len(codes)} states of the code: their jobs may differ for this reason too.")
    between = [axis.label for axis in part.axes if axis.kind == "between sweeps"]
    if between:
        items.append(f"The sweeps themselves differ in {', '.join(between)}, which count as axes here.")
    single = [f"{axis.label} ({axis.key})" for axis in part.axes if not axis.varies]
    if single:
        items.append(f"One value alone, so no figures: {', '.join(single)}.")
    return [*items, Table("Sweeps", sweeps), *([Table("Axes", axes)] if part.axes else [])]


def numbers(part: Collected, run: Run) -> Items:
    """A figure, and for set values a table, of each numeric axis."""
    items: Items = []
    for number, axis in enumerate(part.varied):
        if axis.numeric:
            path = run.path(f"{part.prefix}response_{number}.png")
            items += _sample(part, axis, path) if axis.sampled else _response(part, axis, path)
    return items


def _along(part: Collected, axis: SweepAxis) -> dict[str, list[responses.ResponsePoint]]:
    return {
        score.name: responses.along(axis, part.axes, jobs=part.complete, evidence=part.evidence, name=score.name)
        for score in part.known
    }


def _response(part: Collected, axis: SweepAxis, path: Any) -> Items:
    found = _along(part, axis)
    figures.draw_response(axis, found, path)
    counts = {point.jobs for points in found.values() for point in points}
    uneven = (
        " The numbers of jobs differ, so means are of other settings too; differences are not."
        if len(counts) > 1
        else ""
    )
    words = (
        f"{axis.label} ({axis.key}): mean of each score over all jobs with that value, whatever else was varied, and "
        f"the difference to {axis.label} = {tables.shown(axis.values[0])} over the same drives with the same values "
        f"elsewhere.{uneven}"
    )
    shown = [Table(f"{name} by {axis.label}", tables.response(points, axis, name)) for name, points in found.items()]
    return [words, Picture(f"Scores by {axis.label}", path), *shown]


def _sample(part: Collected, axis: SweepAxis, path: Any) -> Items:
    jobs = {}
    for score in part.known:
        jobs[score.name] = axis.positions(part.complete), [part.evidence.of(job, score.name) for job in part.complete]
    means = {s.name: responses.binned(axis, part.complete, evidence=part.evidence, name=s.name) for s in part.known}
    figures.draw_sample(axis, jobs, means, path)
    words = (
        f"{axis.label} ({axis.key}): every job of the sample is a point, all other axes varied too. Their "
        "intervals are not drawn: jobs from the same starts have much of their error in common. Means of bins with "
        "as many jobs each; their intervals are from drawing jobs."
    )
    return [words, Picture(f"Jobs of the sample by {axis.label}", path)]


def names(part: Collected, run: Run) -> Items:
    """A figure and a table of each axis of names."""
    items: Items = []
    for number, axis in enumerate(part.varied):
        if axis.numeric:
            continue
        found = _along(part, axis)
        words = (
            f"{axis.label} ({axis.key}): mean of each score over all jobs with that value, whatever else was varied."
        )
        path = run.path(f"{part.prefix}names_{number}.png")
        items.append(words)
        if len(axis.values) <= MOST_NAMES:
            figures.draw_names(axis, found, path)
            items.append(Picture(f"Scores by {axis.label}", path))
        items += [Table(f"{name} by {axis.label}", tables.response(p, axis, name)) for name, p in found.items()]
    return items


def pairs(part: Collected, run: Run) -> Items:
    """Heat maps of the pairs of numeric axes whose values were set."""
    gridded = [axis for axis in part.varied if axis.numeric and not axis.sampled]
    chosen = list(itertools.combinations(gridded, 2))[:MOST_PAIRS]
    if not chosen:
        return []
    items: Items = []
    for score in part.known:
        means = {pair: responses.grid(pair, part.complete, evidence=part.evidence, name=score.name) for pair in chosen}
        grids = [(pair, found) for pair, found in means.items() if np.isfinite(found).any()]
        path = run.path(f"{part.prefix}grid_{score.name}.png")
        figures_of_many.draw_grids(grids, score.name, path)
        over = " over all else that was varied" if len(part.varied) > 2 else ""
        items.append(f"Mean {score.told} for every two values{over}; white where no job is complete.")
        items.append(Picture(f"{score.name} over two axes", path))
    return items


def parallel(part: Collected, run: Run) -> Items:
    """Every job across all axes."""
    if len(part.varied) < 3 or len(part.ranking) < 2:
        return []
    score = part.scores[0]
    values = np.array([part.evidence.of(job, score.name).value for job in part.ranking])
    path = run.path(f"{part.prefix}parallel.png")
    figures_of_many.draw_parallel(part.varied, part.ranking, values, best=0, name=score.name, path=path)
    words = (
        f"Each line is a job: where it crosses an axis is its value there, its colour is {score.told}, and the red one "
        "is the best. Where lines of good jobs come together, the value matters."
    )
    return [words, Picture("All jobs across all axes", path)]


def front(part: Collected, run: Run) -> Items:
    """The jobs that no other beats in both scores."""
    if len(part.known) < 2:
        return []
    if part.constants:
        same = " and ".join(part.constants)
        return [f"There is no front: {same} {'is' if len(part.constants) == 1 else 'are'} the same in all jobs."]
    kept = responses.front(part.complete, part.evidence, scores=part.known)
    if not kept:
        return []
    path = run.path(f"{part.prefix}front.png")
    figures_of_many.draw_front(part.complete, kept, part.evidence, scores=part.known, path=path)
    words = (
        f"{part.known[0].told} against {part.known[1].told}: of the jobs on the front none is beaten in one score by a "
        "job that is as good in the other. A number stands beside a point that several share. "
        "Where whiskers overlap, their order may be luck."
    )
    columns = tables.best_jobs(kept, part.axes, part.evidence, part.known)
    caption = "The job on the front" if len(kept) == 1 else f"The {len(kept)} jobs on the front"
    return [words, Picture("Jobs by two scores", path), Table(caption, columns)]


def deciding(part: Collected, run: Run) -> Items:
    """Indices of sensitivity, where the sample allows them."""
    try:
        found = {
            score.name: sensitivity.indices(part.axes, part.complete, evidence=part.evidence, name=score.name)
            for score in part.known
        }
    except UrbanJaxError as error:  # what has been driven is worth a report without them
        return [f"There are no indices: {error}."]
    found = {name: indices for name, indices in found.items() if indices}
    if not found:
        return []
    path = run.path(f"{part.prefix}sensitivity.png")
    figures.draw_sensitivity(found, path)
    words = (
        "S1 is the share of the score's variance over jobs that goes with an axis alone; delta (Borgonovo) is how far "
        "knowing its value moves the score's distribution, together with other axes too. Both are from 0 to 1 and "
        "estimated from these jobs; intervals are from drawing jobs, cut to that range, and do not hold what drives "
        "leave unsure: one that begins at 0 may be of an axis that decides nothing."
        + "".join(f" {name} is left out: it is the same in all jobs." for name in part.constants)
    )
    shown = [Table(f"Indices of {name}", tables.sensitivity(indices)) for name, indices in found.items()]
    return [words, Picture("Sensitivity of the scores", path), *shown]


def of_all(
    jobs: Sequence[SweepJob],
    duplicates: Mapping[str, str],
    counted: SweepCoverage,
    table: Mapping[str, Sequence[Any]],
    parts: Sequence[Collected],
) -> list[Section]:
    """What is said of all experiments together: what is missing, and every job."""
    items: Items = [f"{counted.text}."]
    if not counted.whole:
        left = tables.unfinished(jobs)
        items.append(Table("Jobs that failed or are missing; they stand in no figure and no mean", left))
    if duplicates:
        same = {"job": list(duplicates), "is the same as": list(duplicates.values())}
        items.append(Table("Counted once: same values, same config, same code", same))
    labels = {axis.key: axis.label for part in parts for axis in part.axes}
    shown = {labels.get(name, name): column[:ROWS] for name, column in table.items()}
    rest = f"; {len(jobs) - ROWS} more rows are in table.csv" if len(jobs) > ROWS else ""
    every = Table(f"From the manifests, also in table.csv and table.parquet{rest}", shown)
    return [Section("Coverage", [], items), Section("All jobs", [], [every])]
