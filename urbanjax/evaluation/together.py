"""Drives of several evaluations at once: whatever one program can hold fills its chunks (host side)."""

import functools
from collections.abc import Hashable, Iterator, Sequence
from typing import Any, NamedTuple

from urbanjax.evaluation.batch import CHUNK, Job, Outcome, outcomes
from urbanjax.evaluation.parameter_sets import form_of
from urbanjax.rollout import LoopParams
from urbanjax.types import ProcessError, host_record


@host_record
class Batch:
    """Drives of one evaluation that are alike in how they are driven."""

    name: str  # with which those of its parts begin
    loops: tuple[LoopParams, ...]  # with the driver
    jobs: tuple[Job, ...]  # their `params` count the loops
    traffic: str = "idm"
    chunk: int = CHUNK
    logs: bool = False
    epdms: bool = False
    judged: bool = True

    @functools.cached_property
    def parts(self) -> dict[str, tuple[Job, ...]]:
        """The drives that are kept together, by name: at most `CHUNK` of one mission."""
        by_mission: dict[str, list[Job]] = {}
        for job in self.jobs:
            by_mission.setdefault(job.mission.name, []).append(job)
        return {
            f"{self.name}-{name}-{k // CHUNK:05d}": tuple(jobs[k : k + CHUNK])
            for name, jobs in by_mission.items()
            for k in range(0, len(jobs), CHUNK)
        }

    @property
    def settings(self) -> dict[str, Any]:
        """Keywords of `outcomes`: how its drives are driven."""
        return {name: getattr(self, name) for name in ("traffic", "chunk", "logs", "epdms", "judged")}


class Wanted(NamedTuple):
    """A part that is to be driven."""

    evaluation: Hashable  # whose it is
    batch: Batch
    part: str  # its name

    @property
    def key(self) -> tuple[Hashable, str]:
        """What tells it from all others."""
        return self.evaluation, self.part

    @property
    def jobs(self) -> tuple[Job, ...]:
        """Its drives."""
        return self.batch.parts[self.part]


class Came(NamedTuple):
    """What came of a part: the outcome of every drive, or why there is none."""

    wanted: Wanted
    outcomes: list[Outcome]
    error: Exception | None = None


def together(wanted: Sequence[Wanted]) -> Iterator[Came]:
    """What comes of all parts, program after program.

    Evaluations that differ in values of their parameters alone share programs and their chunks; what comes out for a
    drive is what it would be alone. An evaluation in which something raises has the error as what came of its parts
    that are not driven yet, and ends alone. Args: wanted, the parts.
    """
    programs: dict[Hashable, list[Wanted]] = {}
    forms: dict[int, Hashable] = {}
    for one in wanted:
        if id(one.batch) not in forms:
            forms[id(one.batch)] = _program(one.batch)
        programs.setdefault(forms[id(one.batch)], []).append(one)
    for parts in programs.values():
        yield from _isolated(parts)


def _program(batch: Batch) -> Hashable:
    """What two batches have to share to share a program; an error is none, and shared with nobody."""
    try:
        forms = frozenset(form_of(loop, traffic=batch.traffic) for loop in batch.loops)
    except Exception:  # what is wrong is said when it is driven
        return id(batch)
    return tuple(batch.settings.items()), forms


def _isolated(parts: Sequence[Wanted]) -> Iterator[Came]:
    """What comes of parts of one program; after an error an evaluation at a time."""
    came: set[Hashable] = set()
    try:
        for one in _driven(parts):
            came.add(one.wanted.key)
            yield one
    except ProcessError:
        raise
    except Exception as error:
        left = [part for part in parts if part.key not in came]
        names = dict.fromkeys(part.evaluation for part in left)
        if len(names) == 1:
            yield from (Came(part, [], error) for part in left)
            return
        for name in names:
            yield from _isolated([part for part in left if part.evaluation == name])


def _driven(parts: Sequence[Wanted]) -> Iterator[Came]:
    """The parts through one call of `outcomes`: drives of one shape side by side, whosever they are."""
    firsts: dict[tuple[Hashable, str], int] = {}
    loops: list[LoopParams] = []
    for part in parts:
        if (part.evaluation, part.batch.name) not in firsts:
            firsts[part.evaluation, part.batch.name] = len(loops)
            loops += part.batch.loops
    order = _by_shape(parts)
    jobs = [
        Job(job.mission, job.seed, firsts[part.evaluation, part.batch.name] + job.params)
        for part in order
        for job in part.jobs
    ]
    found = outcomes(loops, jobs, **parts[0].batch.settings)
    for part in order:
        yield Came(part, [_own(next(found), job, part.batch) for job in part.jobs])


def _own(outcome: Outcome, job: Job, batch: Batch) -> Outcome:
    """The outcome as its evaluation knows it: its parameter sets are numbered among its own."""
    row = {name: value for name, value in outcome.row.items() if name != "params"}
    row |= {"params": job.params} if len(batch.loops) > 1 else {}
    return Outcome(job, row, outcome.log, outcome.vehicle)


def _by_shape(parts: Sequence[Wanted]) -> list[Wanted]:
    """The parts, those of one size of road and one duration after the other."""
    shapes: dict[Hashable, list[Wanted]] = {}
    for part in parts:
        mission = part.jobs[0].mission
        shapes.setdefault((mission.size, mission.longest), []).append(part)
    return [part for group in shapes.values() for part in group]
