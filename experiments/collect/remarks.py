"""What a reader of the best job has to know before he believes it, each in a sentence."""

from experiments.collect.axes import SweepAxis, shown
from experiments.collect.collected import Collected
from experiments.collect.known_scores import MEANINGS
from experiments.collect.scores import SECOND
from experiments.collect.sweeps import SweepJob

FEW = 10  # roads or recordings of which an interval is hardly one
UNORDERED = ("seed",)  # keys of numbers that are names: nothing lies beyond the last of them
NAMED = 5  # jobs that are listed


def remarks(part: Collected) -> list[str]:
    """Ties, scores that tell nothing apart, best values at an edge, and intervals of few drives. Args: part."""
    if len(part.ranking) < 2:
        return [*constants(part), *few(part)]
    return [*ties(part), *constants(part), *edges(part), *few(part)]


def meanings(part: Collected) -> list[str]:
    """What the scores are. Args: part."""
    told = [f"{score.name} is {MEANINGS[score.name]}" for score in part.known if score.name in MEANINGS]
    return [f"{'; '.join(told)}."] if told else []


def ties(part: Collected) -> list[str]:
    """Which jobs are exactly as good as the best. Args: part."""
    rest = part.tied[1:]
    if not rest:
        return []
    named = ", ".join(job.title for job in rest[:NAMED]) + (", ..." if len(rest) > NAMED else "")
    return [f"It is tied with {len(rest)} {'other' if len(rest) == 1 else 'others'}: {named}."]


def constants(part: Collected) -> list[str]:
    """Which scores are the same in all jobs. Args: part."""
    told = ["No drive of the whole sweep succeeded."] if nobody_succeeds(part) else []
    for score in part.known:
        if part.constant(score.name):
            value = shown(part.evidence.of(part.ranking[0], score.name).value)
            told.append(f"{score.name} is {value} in all jobs that have it, so it tells none of them apart.")
    return told


def nobody_succeeds(part: Collected) -> bool:
    """Whether there are drives that could have succeeded and none has. Args: part."""
    found = [drives.values[SECOND] for drives in part.evidence.drives.values() if SECOND in drives.values]
    return bool(found) and not any(values.any() for values in found)  # NaN is no failure


def edges(part: Collected) -> list[str]:
    """On which axes the best values are the first or the last ones: those of all jobs that are best. Args: part."""
    ordered = [axis for axis in part.varied if axis.numeric and axis.key.split(".")[-1] not in UNORDERED]
    told = (_edge(axis, part.tied) for axis in ordered)
    return [text for text in told if text]


def _edge(axis: SweepAxis, best: list[SweepJob]) -> str:
    values = {job.value(axis.key) for job in best}
    if len(values) > 1 or (value := values.pop()) not in (axis.values[0], axis.values[-1]):
        return ""
    below = value == axis.values[0]
    which = f"the {'least' if below else 'greatest'} value {'drawn' if axis.sampled else 'asked'}, {shown(value)}"
    # Where a value may not leave the range, nothing lies beyond it.
    if value == axis.bounds[0 if below else 1]:
        return f"The best of {axis.label} is {which}, and the {'least' if below else 'most'} that it may be."
    return f"The best of {axis.label} is {which}: the optimum may lie beyond."


def few(part: Collected) -> list[str]:
    """That few roads or recordings decide, if so. Args: part."""
    drives, scenes = part.evidence.counts(part.ranking[0])
    if not drives or scenes >= FEW:
        return []
    many = len(part.ranking)
    luck = f", and the best of {many} is picked by these same drives (winner's curse)" if many > 1 else ""
    return [
        f"Intervals and differences are from few pairs of drives ({drives} of each job, in {scenes} "
        f"{'scene' if scenes == 1 else 'scenes'}){luck}: drive the best one again with other seeds."
    ]


def of_drives(part: Collected, job: SweepJob) -> str:
    """How many drives a job has, beside its score; nothing without drives. Args: part; job."""
    drives, scenes = part.evidence.counts(job)
    words = ("drive" if drives == 1 else "drives", "scene" if scenes == 1 else "scenes")
    return f" over {drives} {words[0]} in {scenes} {words[1]}" if drives else ""
