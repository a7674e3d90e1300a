"""Many drives through one compiled program: so many at once, and where one ends the next one takes its place.

A chunk is what one program computes at once, and as many run at the same time as there are devices, or cores of a CPU;
places that nobody takes any more hold repeats. What comes out for a drive does not depend on which others share its
chunk, nor on when it began.
"""

import dataclasses
import functools
import itertools
from collections.abc import Hashable, Iterable, Iterator, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.drivers import IdmDriver
from urbanjax.evaluation import programs, whereabouts
from urbanjax.evaluation.case import Case
from urbanjax.evaluation.missions.localized import GIVEN, LocalizedMission
from urbanjax.evaluation.missions.protocol import Drives
from urbanjax.evaluation.missions.recorded import RecordedMission
from urbanjax.evaluation.parameter_sets import ParameterSets, parameter_sets
from urbanjax.evaluation.programs import SEARCH, SEGMENT, compiled
from urbanjax.evaluation.scores.epdms_windows import PERIOD
from urbanjax.evaluation.streams import dealt, streams
from urbanjax.evaluation.traffic import as_recorded, mannered
from urbanjax.evaluation.whereabouts import Whereabouts
from urbanjax.rollout import LoopParams, Underway
from urbanjax.sim.log import Log
from urbanjax.types import ConfigError, host_record
from urbanjax.vehicle.params import VehicleParams

CHUNK = 16  # drives at once: faster per drive than one or 64


@host_record
class Job:
    """One drive to be done."""

    mission: Drives
    seed: int
    params: int = 0  # number of the parameter set that drives


@host_record
class Outcome:
    """What came of one drive."""

    job: Job
    row: dict[str, Any]  # numbers, flags and names by column
    log: Log | None = None  # [T], where it was asked for
    vehicle: VehicleParams | None = None  # of a drive that has its own


Numbered = tuple[int, Job]


def outcomes(
    loop: LoopParams | Sequence[LoopParams],
    jobs: Sequence[Job],
    *,
    traffic: str = "idm",
    chunk: int = CHUNK,
    logs: bool = False,
    epdms: bool = False,
    judged: bool = True,
) -> Iterator[Outcome]:
    """The outcome of every job, in their order, as drives end.

    All missions of one size share a program, and so do parameter sets. Args: loop, with the driver, or several of them
    that differ in values alone: then jobs say of which they are, and rows say it in the column `params`; jobs; traffic,
    how the others drive (see `evaluation.traffic`); chunk, drives at once on each device (on scans they go one by one);
    logs, whether they are kept; epdms, whether rows hold that score too, for which `pdm` drives beside everybody;
    judged, whether rows say more than which drive they are of. Raises ConfigError for `epdms` with another period than
    its own, for sets that no one program holds, and for a job of a set that there is not.
    """
    sets = parameter_sets(loop, traffic=traffic, asked={job.params for job in jobs})
    if epdms and not np.isclose(sets.period, PERIOD):
        raise ConfigError(f"'epdms' is defined on steps of {PERIOD} s, and 'period' is {sets.period:g} s")
    early: dict[int, Outcome] = {}
    following = 0
    for number, outcome in _ended(sets, jobs, traffic, chunk, logs, epdms, judged):
        early[number] = outcome
        while following in early:
            yield early.pop(following)
            following += 1


def _ended(
    sets: ParameterSets, jobs: Sequence[Job], traffic: str, chunk: int, logs: bool, epdms: bool, judged: bool
) -> Iterator[tuple[int, Outcome]]:
    """Numbers and outcomes as drives end, the jobs dealt out to streams; those of one size after the other."""
    for _, group in itertools.groupby(enumerate(jobs), key=lambda pair: _shape(pair[1])):
        numbered = list(group)
        at_once = 1 if isinstance(numbered[0][1].mission, LocalizedMission) else chunk  # scans are work enough
        drive = functools.partial(_stream, sets, traffic=traffic, chunk=at_once, logs=logs, epdms=epdms, judged=judged)
        yield from dealt(numbered, drive, devices=streams()[: -(-len(numbered) // at_once)])


def _shape(job: Job) -> tuple[Hashable, float]:
    """What the shapes of a drive and of its log depend on."""
    return job.mission.size, job.mission.longest


def case_of(loop: LoopParams, job: Job, *, traffic: str) -> Case:
    """The drive that a job is about, before anybody is replayed.

    Args: loop, for vehicle and traffic; job; traffic, how the others drive.
    """
    case = job.mission.case(job.seed, others=loop.sim.traffic, vehicle=loop.vehicle)
    return dataclasses.replace(case, start=mannered(case.start, traffic, seed=job.seed))


def _cases(sets: ParameterSets, jobs: Iterable[Numbered], traffic: str) -> Iterator[tuple[int, Job, Case]]:
    """The jobs with their drives; those of replayed traffic are driven by IDM first, a chunk at a time."""
    if traffic != "replay":
        for number, job in jobs:
            yield number, job, case_of(sets.each[job.params], job, traffic=traffic)
        return
    waiting, follower = iter(jobs), sets.with_driver(IdmDriver())
    while part := list(itertools.islice(waiting, CHUNK)):
        if isinstance(part[0][1].mission, RecordedMission):
            yield from ((number, job, case_of(sets.each[job.params], job, traffic=traffic)) for number, job in part)
            continue
        asked = dict(part)
        given = [(number, dataclasses.replace(job, mission=_given(job.mission))) for number, job in part]
        for number, one in _stream(follower, given, "idm", CHUNK, logs=True, whole=True, judged=False):
            assert one.log is not None
            case = case_of(sets.each[one.job.params], asked[number], traffic=traffic)
            start = as_recorded(case.start, one.log, period=sets.period)
            yield number, asked[number], dataclasses.replace(case, start=start)


def _given(mission: Drives) -> Drives:
    """The same drives with their poses given."""
    return mission.mission if isinstance(mission, LocalizedMission) else mission


@dataclasses.dataclass
class _Place:
    """One place of the chunk: whose drive it holds, and the logs so far."""

    number: int
    job: Job
    case: Case
    parts: list[Log]
    references: list[Log]  # where they are asked for, one for each part
    believed: list[Whereabouts]  # on scans, one for each part


def _stream(
    sets: ParameterSets,
    jobs: Iterable[Numbered],
    traffic: str,
    chunk: int,
    logs: bool,
    whole: bool = False,
    epdms: bool = False,
    judged: bool = True,
) -> Iterator[tuple[int, Outcome]]:
    """The drives of one device: every place of the chunk is filled again as soon as its drive has ended.

    Where the `whole` is asked for they go on to the end of the longest drive.
    """
    waiting = _cases(sets, jobs, traffic)
    places: list[_Place | None] = [None] * chunk
    ended: list[_Place] = []
    now: Underway | None = None
    cases: list[Case] = []
    loop = sets.at([0] * chunk)
    while True:
        new = np.zeros(chunk, bool)
        for k in range(chunk):
            if places[k] is None and (found := next(waiting, None)) is not None:
                places[k], new[k] = _Place(*found, [], [], []), True
        if not any(places):
            break
        spare = next(place.case for place in places if place)
        cases = [place.case if place else (cases[k] if cases else spare) for k, place in enumerate(places)]
        stacked = _stacked(cases)
        if new.any():
            loop = sets.at([place.job.params if place else 0 for place in places])
            fresh = compiled(programs.fresh)(loop, stacked)
            now = fresh if now is None else compiled(programs.renewed)(now, fresh, new=new)
        theirs = jax.device_get(compiled(programs.references)(loop, stacked, now=now)) if epdms else None
        now, *seen = jax.block_until_ready(compiled(programs.segment)(loop, stacked, now=now))
        log, going, believed = jax.device_get(seen)
        for k, place in enumerate(places):
            if place is None:
                continue
            place.parts.append(jax.tree.map(lambda x, k=k: x[k], log))
            place.references += [jax.tree.map(lambda x, k=k: x[k], theirs)] if theirs is not None else []
            place.believed += [jax.tree.map(lambda x, k=k: x[k], believed)] if believed is not None else []
            if (not going[k] and not whole) or len(place.parts) * SEGMENT >= _longest(place.job, sets.period):
                ended.append(place)
                places[k] = None
        while len(ended) >= chunk:
            yield from _outcomes(sets, ended[:chunk], traffic, chunk, logs, judged)
            ended = ended[chunk:]
    if ended:
        yield from _outcomes(sets, ended, traffic, chunk, logs, judged)


def _longest(job: Job, period: float) -> int:
    """Steps of the longest drive of a mission."""
    return round(job.mission.longest / period)


def _outcomes(
    sets: ParameterSets, ended: list[_Place], traffic: str, chunk: int, logs: bool, judged: bool
) -> Iterator[tuple[int, Outcome]]:
    """What came of drives that have ended, at most a chunk of them."""
    longest = _longest(ended[0].job, sets.period)
    full = ended + [ended[-1]] * (chunk - len(ended))
    whole = [_padded(place.parts, longest, sets.period) for place in full]
    rows = _columns(sets, full, whole) if judged else {}
    for k, place in enumerate(ended):
        mission = place.job.mission
        row = {"mission": mission.name, "seed": place.job.seed, "traffic": traffic}
        row["localization"] = mission.how if isinstance(mission, LocalizedMission) else GIVEN
        row |= {"params": place.job.params} if len(sets.each) > 1 else {}
        row |= {name: values[k] for name, values in rows.items()}
        if judged:
            row |= whereabouts.columns(place.believed, duration=float(row["duration_s"]), period=sets.period)
        yield place.number, Outcome(place.job, row, whole[k] if logs else None, place.case.vehicle)


def _columns(sets: ParameterSets, places: list[_Place], whole: list[Log]) -> dict[str, Any]:
    """What is said of a chunk of drives, columns [C]. Args: whole, their logs."""
    stacked, loop = _stacked(whole), sets.at([place.job.params for place in places])
    cases = _stacked([place.case for place in places])
    rows = jax.device_get(compiled(programs.columns)(loop, cases, logs=stacked))
    if places[0].references:
        count = -(-len(whole[0].time) // SEGMENT)
        held = [(place.references + place.references[-1:] * count)[:count] for place in places]
        theirs = _stacked([jax.tree.map(lambda *x: np.stack(x), *logs) for logs in held])
        rows |= jax.device_get(compiled(programs.epdms_columns)(loop, cases, logs=stacked, theirs=theirs))
    return rows


def _stacked(cases: Sequence[Any]) -> Any:
    return jax.tree.map(lambda *x: jnp.asarray(np.stack(x)), *cases)


def _padded(parts: list[Log], steps: int, period: float) -> Log:
    """The parts of a log joined, and its end held until there are as many steps as in any."""

    def join(*x: np.ndarray) -> np.ndarray:
        joined = np.concatenate(x)[:steps]
        return np.concatenate([joined, np.repeat(joined[-1:], steps - len(joined), axis=0)])

    log = jax.tree.map(join, *parts)
    known = min(len(parts) * SEGMENT, steps)
    later = log.time[known - 1] + period * np.arange(1, steps - known + 1, dtype=log.time.dtype)
    return dataclasses.replace(log, time=np.concatenate([log.time[:known], later]))


def moment(loop: LoopParams | Sequence[LoopParams], job: Job, *, traffic: str, time: float, chunk: int = CHUNK) -> Any:
    """The driver's info in the step at a time of a drive, for whoever asks why.

    Up to the last multiple of `SEGMENT` steps by the program that drove it, from there step by step.
    Args: loop, with the driver, or several as for `outcomes`; job; traffic, how the others drive; time [s] since the
    start; chunk, of the drive.
    """
    sets = parameter_sets(loop, traffic=traffic, asked={job.params})
    ((_, _, case),) = _cases(sets, [(0, job)], traffic)
    chunk = 1 if case.sensing is not None else chunk
    cases, loop = _stacked([case] * chunk), sets.at([job.params] * chunk)
    now = compiled(programs.fresh)(loop, cases)
    steps = max(round(time / sets.period), 0)
    for _ in range(steps // SEGMENT):
        now, *_ = compiled(programs.segment)(loop, cases, now=now)
    info = None
    for k in range(steps % SEGMENT + 1):
        if k % SEARCH == 0 and case.sensing is not None:
            now = compiled(programs.searched)(loop, cases, now=now)
        now, info = compiled(programs.one_step)(loop, cases, now=now)
    return jax.tree.map(lambda x: x[0], jax.device_get(info))
