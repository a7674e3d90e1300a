"""Many drives through one compiled program: so many at once, and where one ends the next one takes its place.

A chunk is what one program computes at once, and as many run at the same time as there are devices, or cores of a CPU;
places that nobody takes any more hold repeats. What comes out for a drive does not depend on which others share its
chunk, nor on when it began.
"""

import contextlib
import dataclasses
import itertools
import os
import queue
import threading
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.drivers import IdmDriver
from urbanjax.evaluation import programs, whereabouts
from urbanjax.evaluation.case import Case
from urbanjax.evaluation.missions.localized import LocalizedMission
from urbanjax.evaluation.missions.mission import LONGEST, Mission
from urbanjax.evaluation.missions.recorded import RecordedMission
from urbanjax.evaluation.programs import SEARCH, SEGMENT, compiled
from urbanjax.evaluation.scores.epdms_windows import PERIOD
from urbanjax.evaluation.traffic import as_recorded, mannered, mannered_sim
from urbanjax.evaluation.whereabouts import Whereabouts
from urbanjax.rollout import LoopParams, Underway
from urbanjax.sim.log import Log
from urbanjax.types import ConfigError, as_arrays, host_record
from urbanjax.vehicle.params import VehicleParams

CHUNK = 16  # drives at once: faster per drive than one or 64


@host_record
class Job:
    """One drive to be done."""

    mission: Mission | LocalizedMission | RecordedMission
    seed: int


@host_record
class Outcome:
    """What came of one drive."""

    job: Job
    row: dict[str, Any]  # numbers, flags and names by column
    log: Log | None = None  # [T], where it was asked for
    vehicle: VehicleParams | None = None  # of a drive that has its own


Numbered = tuple[int, Job]


def outcomes(
    loop: LoopParams,
    jobs: Sequence[Job],
    *,
    traffic: str = "idm",
    chunk: int = CHUNK,
    logs: bool = False,
    epdms: bool = False,
) -> Iterator[Outcome]:
    """The outcome of every job, in their order, as drives end.

    All missions of one size share a program. Args: loop, with the driver; jobs; traffic, how the others drive (see
    `evaluation.traffic`); chunk, drives at once on each device; logs, whether they are kept; epdms, whether rows hold
    that score too, for which `pdm` drives beside everybody. Raises ConfigError for it with another period than its own.
    """
    if epdms and not np.isclose(float(loop.period), PERIOD):
        raise ConfigError(f"'epdms' is defined on steps of {PERIOD} s, and 'period' is {float(loop.period):g} s")
    loop = as_arrays(loop.replace(sim=mannered_sim(loop.sim, traffic)))
    early: dict[int, Outcome] = {}
    following = 0
    for number, outcome in _ended(loop, jobs, traffic, chunk, logs, epdms):
        early[number] = outcome
        while following in early:
            yield early.pop(following)
            following += 1


def _ended(
    loop: LoopParams, jobs: Sequence[Job], traffic: str, chunk: int, logs: bool, epdms: bool
) -> Iterator[tuple[int, Outcome]]:
    """Numbers and outcomes as drives end, the jobs dealt out to streams; those of one size after the other."""
    for _, group in itertools.groupby(enumerate(jobs), key=lambda pair: pair[1].mission.size):
        numbered = list(group)
        at_once = 1 if isinstance(numbered[0][1].mission, LocalizedMission) else chunk
        needed = streams()[: -(-len(numbered) // at_once)]
        if len(needed) == 1:
            yield from _stream(loop, numbered, traffic, at_once, logs, epdms=epdms)
            continue
        found: queue.SimpleQueue = queue.SimpleQueue()
        wanted = _Shared(numbered)

        def work(
            device: Any, found: queue.SimpleQueue = found, wanted: _Shared = wanted, at_once: int = at_once
        ) -> None:
            end: Any = None
            try:
                with jax.default_device(device) if device else contextlib.nullcontext():
                    for pair in _stream(loop, wanted, traffic, at_once, logs, epdms=epdms):
                        found.put(pair)
            except BaseException as error:
                end = error
            finally:
                found.put(end)

        with ThreadPoolExecutor(len(needed)) as pool:
            try:
                for device in needed:
                    pool.submit(work, device)
                ended = 0
                while ended < len(needed):
                    pair = found.get()
                    if isinstance(pair, BaseException):
                        raise pair
                    ended += pair is None
                    if pair is not None:
                        yield pair
            finally:
                wanted.end()  # the others end with the drives that they have begun


class _Shared:
    """An iterator that several threads take from."""

    def __init__(self, items: Iterable[Numbered]) -> None:
        self._items, self._lock = iter(items), threading.Lock()

    def __iter__(self) -> "_Shared":
        return self

    def __next__(self) -> Numbered:
        with self._lock:
            return next(self._items)

    def end(self) -> None:
        """Let there be no further items."""
        with self._lock:
            self._items = iter(())


def streams() -> list[Any]:
    """The device of every stream of chunks, None for the only one: a chunk by itself leaves cores of a CPU idle."""
    devices = jax.local_devices()
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    at_once = max(cores // len(devices), 1) if devices[0].platform == "cpu" else 1
    return [None] * at_once if len(devices) == 1 else [device for _ in range(at_once) for device in devices]


def case_of(loop: LoopParams, job: Job, *, traffic: str) -> Case:
    """The drive that a job is about, before anybody is replayed.

    Args: loop, for vehicle and traffic; job; traffic, how the others drive.
    """
    case = job.mission.case(job.seed, others=loop.sim.traffic, vehicle=loop.vehicle)
    return dataclasses.replace(case, start=mannered(case.start, traffic, seed=job.seed))


def _cases(loop: LoopParams, jobs: Iterable[Numbered], traffic: str, chunk: int) -> Iterator[tuple[int, Job, Case]]:
    """The jobs with their drives; those of replayed traffic are driven by IDM first, a chunk at a time."""
    if traffic != "replay":
        for number, job in jobs:
            yield number, job, case_of(loop, job, traffic=traffic)
        return
    waiting, follower = iter(jobs), loop.replace(driver=as_arrays(IdmDriver()))
    while part := list(itertools.islice(waiting, chunk)):
        if isinstance(part[0][1].mission, RecordedMission):
            yield from ((number, job, case_of(loop, job, traffic=traffic)) for number, job in part)
            continue
        for number, one in _stream(follower, part, "idm", chunk, logs=True, whole=True):
            assert one.log is not None
            case = case_of(loop, one.job, traffic=traffic)
            start = as_recorded(case.start, one.log, period=float(loop.period))
            yield number, one.job, dataclasses.replace(case, start=start)


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
    loop: LoopParams,
    jobs: Iterable[Numbered],
    traffic: str,
    chunk: int,
    logs: bool,
    whole: bool = False,
    epdms: bool = False,
) -> Iterator[tuple[int, Outcome]]:
    """The drives of one device: every place of the chunk is filled again as soon as its drive has ended.

    Where the `whole` is asked for they go on to the end of the longest drive.
    """
    waiting = _cases(loop, jobs, traffic, chunk)
    places: list[_Place | None] = [None] * chunk
    ended: list[_Place] = []
    longest = round(LONGEST / float(loop.period))
    now: Underway | None = None
    cases: list[Case] = []
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
            if (not going[k] and not whole) or len(place.parts) * SEGMENT >= longest:
                ended.append(place)
                places[k] = None
        while len(ended) >= chunk:
            yield from _judged(loop, ended[:chunk], traffic, chunk, logs)
            ended = ended[chunk:]
    if ended:
        yield from _judged(loop, ended, traffic, chunk, logs)


def _judged(
    loop: LoopParams, ended: list[_Place], traffic: str, chunk: int, logs: bool
) -> Iterator[tuple[int, Outcome]]:
    """What came of drives that have ended, at most a chunk of them."""
    longest = round(LONGEST / float(loop.period))
    full = ended + [ended[-1]] * (chunk - len(ended))
    whole = [_padded(place.parts, longest, float(loop.period)) for place in full]
    stacked = _stacked(whole)
    cases = _stacked([place.case for place in full])
    rows = jax.device_get(compiled(programs.columns)(loop, cases, logs=stacked))
    if full[0].references:
        count = -(-longest // SEGMENT)
        held = [(place.references + place.references[-1:] * count)[:count] for place in full]
        theirs = _stacked([jax.tree.map(lambda *x: np.stack(x), *logs) for logs in held])
        rows |= jax.device_get(compiled(programs.epdms_columns)(loop, cases, logs=stacked, theirs=theirs))
    for k, place in enumerate(ended):
        row = {"mission": place.job.mission.name, "seed": place.job.seed, "traffic": traffic}
        row |= {name: values[k] for name, values in rows.items()}
        if place.believed:
            believed, period = jax.tree.map(lambda *x: np.concatenate(x), *place.believed), float(loop.period)
            row |= whereabouts.columns(believed, steps=round(float(row["duration_s"]) / period), period=period)
        yield place.number, Outcome(place.job, row, whole[k] if logs else None, place.case.vehicle)


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


def moment(loop: LoopParams, job: Job, *, traffic: str, time: float, chunk: int = CHUNK) -> Any:
    """The driver's info in the step at a time of a drive, for whoever asks why.

    Up to the last multiple of `SEGMENT` steps by the program that drove it, from there step by step.
    Args: loop, with the driver; job; traffic, how the others drive; time [s] since the start; chunk, of the drive.
    """
    loop = as_arrays(loop.replace(sim=mannered_sim(loop.sim, traffic)))
    ((_, _, case),) = _cases(loop, [(0, job)], traffic, chunk)
    cases = _stacked([case] * (1 if case.sensing is not None else chunk))
    now = compiled(programs.fresh)(loop, cases)
    steps = max(round(time / float(loop.period)), 0)
    for _ in range(steps // SEGMENT):
        now, *_ = compiled(programs.segment)(loop, cases, now=now)
    info = None
    for k in range(steps % SEGMENT + 1):
        if k % SEARCH == 0 and cases.sensing is not None:
            now = compiled(programs.searched)(loop, cases, now=now)
        now, info = compiled(programs.one_step)(loop, cases, now=now)
    return jax.tree.map(lambda x: x[0], jax.device_get(info))
