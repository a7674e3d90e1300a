"""Many drives: chunks of one fixed size through one compiled program, each until its last drive is done.

A chunk is what one device computes at once; the last one is filled up with repeats. What comes out for a drive does
not depend on which others share its chunk.
"""

import dataclasses
import functools
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.evaluation.case import Case
from urbanjax.evaluation.facts import facts
from urbanjax.evaluation.missions.mission import LONGEST, Mission
from urbanjax.evaluation.traffic import mannered, mannered_sim
from urbanjax.evaluation.verdict import judge
from urbanjax.numerics.compiling import compiler_options
from urbanjax.rollout import LoopParams, Underway, begin, go_on
from urbanjax.sim.log import Log
from urbanjax.types import as_arrays, host_record

CHUNK = 16  # drives at once: faster per drive than one or 64
SEGMENT = 50  # steps between two looks at whether anybody is still driving


@host_record
class Job:
    """One drive to be done."""

    mission: Mission
    seed: int


@host_record
class Outcome:
    """What came of one drive."""

    job: Job
    row: dict[str, Any]  # numbers, flags and names by column
    log: Log | None = None  # [T], where it was asked for


def outcomes(
    loop: LoopParams, jobs: Sequence[Job], *, traffic: str = "idm", chunk: int = CHUNK, logs: bool = False
) -> Iterator[Outcome]:
    """The outcome of every job, in their order, as chunks end.

    All missions of one size share a program. Args: loop, with the driver; jobs; traffic, how the others drive (see
    `evaluation.traffic`); chunk, drives at once on each device; logs, whether they are kept.
    """
    loop = as_arrays(loop.replace(sim=mannered_sim(loop.sim, traffic)))
    parts = [jobs[k : k + chunk] for k in range(0, len(jobs), chunk)]
    devices = jax.local_devices()

    def work(k: int) -> list[Outcome]:
        with jax.default_device(devices[k % len(devices)]):
            return _drive(loop, parts[k], traffic, chunk, logs)

    if len(devices) == 1:
        for k in range(len(parts)):
            yield from work(k)
        return
    with ThreadPoolExecutor(len(devices)) as pool:
        for done in pool.map(work, range(len(parts))):
            yield from done


def case_of(loop: LoopParams, job: Job, *, traffic: str) -> Case:
    """The drive that a job is about. Args: loop, for vehicle and traffic; job; traffic, how the others drive."""
    case = job.mission.case(job.seed, others=loop.sim.traffic, vehicle=loop.vehicle)
    return dataclasses.replace(case, start=mannered(case.start, traffic, seed=job.seed))


def _drive(loop: LoopParams, jobs: Sequence[Job], traffic: str, chunk: int, logs: bool) -> list[Outcome]:
    """One chunk."""
    found = [case_of(loop, job, traffic=traffic) for job in jobs]
    found += [found[-1]] * (chunk - len(found))
    cases = _stacked(found)
    longest = round(LONGEST / float(loop.period))
    now = _compiled(_begin)(loop, cases)
    parts, driven = [], 0
    while driven < longest:
        now, log, going = _compiled(_segment)(loop, cases, now)
        parts.append(jax.device_get(log))
        driven += SEGMENT
        if not bool(np.any(going[: len(jobs)])):
            break
    whole = _padded(parts, longest, float(loop.period))
    rows = jax.device_get(_compiled(_judge)(loop, cases, whole))
    return [
        Outcome(
            job,
            {"mission": job.mission.name, "seed": job.seed, "traffic": traffic, **{n: v[k] for n, v in rows.items()}},
            jax.tree.map(lambda x, k=k: x[k], whole) if logs else None,
        )
        for k, job in enumerate(jobs)
    ]


def _stacked(cases: Sequence[Case]) -> Case:
    return jax.tree.map(lambda *x: jnp.asarray(np.stack(x)), *cases)


def _padded(parts: list[Log], steps: int, period: float) -> Log:
    """The parts of a log joined, and its end held until there are as many steps as in any."""

    def join(*x: np.ndarray) -> np.ndarray:
        joined = np.concatenate(x, axis=1)[:, :steps]
        missing = steps - joined.shape[1]
        return np.concatenate([joined, np.repeat(joined[:, -1:], missing, axis=1)], axis=1) if missing else joined

    log = jax.tree.map(join, *parts)
    known = min(len(parts) * SEGMENT, steps)
    later = log.time[:, known - 1 : known] + period * np.arange(1, steps - known + 1, dtype=log.time.dtype)
    return dataclasses.replace(log, time=np.concatenate([log.time[:, :known], later], axis=1))


def _nothing(info: Any) -> None:
    return None


def _all(info: Any) -> Any:
    return info


@functools.cache
def _compiled(function: Callable) -> Callable:
    """The function as a program; made when it is needed, since its options depend on the device."""
    return jax.jit(function, compiler_options=compiler_options())


def _begin(loop: LoopParams, cases: Case) -> Underway:
    return jax.vmap(lambda case: begin(loop, case.course, start=case.start))(cases)


def _segment(loop: LoopParams, cases: Case, now: Underway) -> tuple[Underway, Log, jax.Array]:
    """`SEGMENT` steps of all, and which of them are still driving."""

    def one(case: Case, now: Underway) -> tuple[Underway, Log, jax.Array]:
        after, (log, _) = go_on(loop, case.course, lanes=case.lanes, now=now, n_steps=SEGMENT, keep=_nothing)
        seen = facts(log, case, vehicle=loop.vehicle)
        late = after.world.time - case.start.time > case.limit
        return after, log, ~jnp.any(seen.station >= case.goal) & ~late

    return jax.vmap(one)(cases, now)


def _one_step(loop: LoopParams, cases: Case, now: Underway) -> tuple[Underway, Any]:
    """One step of all, and what the driver says of it."""

    def one(case: Case, now: Underway) -> tuple[Underway, Any]:
        after, (_, info) = go_on(loop, case.course, lanes=case.lanes, now=now, n_steps=1, keep=_all)
        return after, jax.tree.map(lambda x: x[0], info)

    return jax.vmap(one)(cases, now)


def _judge(loop: LoopParams, cases: Case, logs: Log) -> dict[str, jax.Array]:
    def one(case: Case, log: Log) -> dict[str, jax.Array]:
        return judge(facts(log, case, vehicle=loop.vehicle), loop.vehicle)

    return jax.vmap(one)(cases, logs)


def moment(loop: LoopParams, job: Job, *, traffic: str, time: float, chunk: int = CHUNK) -> Any:
    """The driver's info in the step at a time of a drive, for whoever asks why.

    Up to the last multiple of `SEGMENT` steps by the program that drove it, from there step by step.
    Args: loop, with the driver; job; traffic, how the others drive; time [s] since the start; chunk, of the drive.
    """
    loop = as_arrays(loop.replace(sim=mannered_sim(loop.sim, traffic)))
    cases = _stacked([case_of(loop, job, traffic=traffic)] * chunk)
    now = _compiled(_begin)(loop, cases)
    steps = max(round(time / float(loop.period)), 0)
    for _ in range(steps // SEGMENT):
        now, _, _ = _compiled(_segment)(loop, cases, now)
    info = None
    for _ in range(steps % SEGMENT + 1):
        now, info = _compiled(_one_step)(loop, cases, now)
    return jax.tree.map(lambda x: x[0], jax.device_get(info))
