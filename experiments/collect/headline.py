"""The best job, how sure that is, and what it is better than."""

from experiments.collect import remarks, responses, tables
from experiments.collect.axes import setting
from experiments.collect.collected import Collected
from experiments.collect.sweeps import SweepJob, at
from urbanjax.io.runs.report import Picture, Table

BRACKETS = "Brackets and whiskers are 95 % intervals: "
OF_DRIVES = "of shares Wilson's, of means and paired differences from drawing whole roads or recordings of the drives."
OF_SUMMARIES = "those of the jobs' own summaries; a mean over jobs has the mean of theirs, as if all erred alike."
NO_ROWS = "The jobs hold no drives, so nothing can be compared drive by drive: differences are left out."
Items = list[Table | Picture | str]


def came_out(part: Collected) -> Items:
    """The section of the best job. Args: part."""
    if not part.ranking:
        return [_none(part), *_unreadable(part)]
    best, score = part.ranking[0], part.scores[0]
    value = tables.text(part.evidence.of(best, score.name)) + remarks.of_drives(part, best)
    items: Items = [
        f"Best of {len(part.ranking)} jobs by {score.told} is {best.title} with {value}: {setting(best, part.axes)}. "
        f"{part.prefix}best.yaml holds its values. A best of many is in part luck: "
        "the interval is that of this job alone.",
        *remarks.remarks(part),
        *remarks.meanings(part),
        BRACKETS + (OF_DRIVES if part.evidence.drives else OF_SUMMARIES),
    ]
    unknown = len(part.complete) - len(part.ranking)
    if unknown:
        items.append(f"{unknown} complete jobs have no finite {score.name}: they stand in no figure.")
    order = part.ranking[:10]
    shown = Table("The best jobs", tables.best_jobs(order, part.axes, part.evidence, part.known))
    return [*items, *_unreadable(part), *_differences(part), shown]


def _none(part: Collected) -> str:
    complete = len(part.complete)
    why = f"none of the {complete} complete jobs has one that is finite" if complete else "no job is complete"
    asked_for = part.scores[0].name if part.scores else "a score"
    return f"There is no best job: {asked_for} is not known, since {why}."


def _differences(part: Collected) -> Items:
    rest = _compared(part)
    if not rest:
        return []
    if not part.evidence.drives:
        return [NO_ROWS]
    found = tables.differences(part.ranking[0], rest, axes=part.axes, evidence=part.evidence, scores=part.known)
    return [Table("Paired differences over the same drives (driver, traffic, mission and seed)", found)]


def _unreadable(part: Collected) -> Items:
    return [f"{title}: {why}; its summary is used instead." for title, why in part.evidence.unreadable.items()]


def _compared(part: Collected) -> dict[str, SweepJob]:
    """What the best job is compared with, by who it is."""
    worse = part.ranking[len(part.tied) :]
    rest = {"second best": worse[0]} if worse else dict(zip(["tied with it"], part.ranking[1:], strict=False))
    defaults = {axis.key: at(part.plans[0].config, axis.key) for axis in part.axes}
    nearest = responses.nearest_defaults(part.ranking, part.axes, defaults=defaults)
    if nearest is not None and nearest is not part.ranking[0]:
        rest["nearest to the values without overrides"] = nearest
    return rest
