"""One family of encounters and one driver: what comes of points of the space of its numbers (host side)."""

import functools
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from urbanjax.evaluation.case import Case
from urbanjax.evaluation.facts import facts
from urbanjax.evaluation.fault import at_fault
from urbanjax.evaluation.missions.found import encounter_case
from urbanjax.numerics.compiling import compiler_options
from urbanjax.rollout import LoopParams, begin, steps_of
from urbanjax.sim.log import Log
from urbanjax.sim.scenarios.encounter_families import Family
from urbanjax.sim.scenarios.encounters import Encounter, EncounterPlace, meet
from urbanjax.tuning.adversary.braking import Avoidance, avoidance
from urbanjax.tuning.adversary.threat import ThreatParams, threat
from urbanjax.tuning.losses.unrolled import unrolled
from urbanjax.tuning.spaces import Space, space
from urbanjax.types import as_arrays, host_record, pytree

PARTS = 3  # of each number's range, that tell failures apart
STEP_CLIP = 1e3  # greatest norm of what a step hands back: beyond what encounters give, short of overflow
CHUNK = 16  # drives at once: what any of the programs computes


@host_record
class Verdicts:
    """What came of N points; failures are told by the hard rule, in the hard drive."""

    threat: np.ndarray  # [N] m
    failed: np.ndarray  # [N] bool, a collision at the ego's fault
    avoidable: np.ndarray  # [N] bool, and braking in full would have avoided it
    latest: np.ndarray  # [N] s, when that had to begin at the latest
    gradients: np.ndarray | None = None  # [N, P] of the threat by z


@pytree
class EncounterDrive:
    """What came of one drive, on the device."""

    log: Log
    collision: Array  # [T] bool, steps in which one begins at the ego's fault


@host_record
class Arena:
    """A driver in a family of encounters; `judged` and `sloped` are what searches ask."""

    family: Family
    space: Space
    hard: LoopParams
    relaxed: LoopParams  # that gradients go through; drives as `hard` does
    case: Case  # before anybody meets
    place: EncounterPlace
    params: ThreatParams
    steps: int

    def judged(self, z: np.ndarray) -> Verdicts:
        """What comes of points. Args: z [N, P]."""
        return self._chunks(_valued, self.hard, z)

    def sloped(self, z: np.ndarray) -> Verdicts:
        """The same with gradients. Args: z [N, P]."""
        return self._chunks(_sloped, self.relaxed, z)

    def numbers(self, z: np.ndarray) -> dict[str, float]:
        """The numbers of a point by key. Args: z [P]."""
        return self.space.values(jnp.asarray(z, float))

    def shares(self, z: np.ndarray) -> np.ndarray:
        """Where points lie in the range of each number, [N, P] from 0 to 1. Args: z [N, P]."""
        low, high = (np.array([getattr(n, end) for n in self.space.numbers]) for end in ("low", "high"))
        base = as_arrays(self.family.numbers)
        there = jax.vmap(lambda one: self.space.params(one, base))(jnp.asarray(z, float))
        values = np.stack([np.asarray(getattr(there, key)) for key in self.space.keys], axis=1)
        return (values - low) / (high - low)

    def cells(self, z: np.ndarray) -> np.ndarray:
        """The cells of points, [N, P]: of every number the lower, middle or upper part of its range. Args: z [N, P]."""
        return np.clip((PARTS * self.shares(z)).astype(int), 0, PARTS - 1)

    def cost_of_gradient(self, repeats: int = 3) -> float:
        """How many evaluations one with its gradient costs here and now: the ratio of least times, compiled.

        On the CPU these are of the processor, which others may share; of the drives alone, without the oracle.

        Args: repeats, of each.
        """
        clock = time.process_time if jax.default_backend() == "cpu" else time.perf_counter
        z = np.random.default_rng(0).normal(size=(CHUNK, len(self.space.keys)))
        met, _ = _linearised(self.family, self.space, self.place, jnp.asarray(z, float))
        least = []
        for program, loop in ((_valued, self.hard), (_sloped, self.relaxed)):
            times = []
            for _ in range(repeats + 1):
                begin = clock()
                driven = _program(program)(loop, self.case, encounters=met, params=self.params, n_steps=self.steps)
                jax.block_until_ready(driven)
                times.append(clock() - begin)
            least.append(min(times[1:]))
        return least[1] / least[0]

    def _chunks(self, program: Callable[..., Any], loop: LoopParams, z: np.ndarray) -> Verdicts:
        parts = [self._chunk(program, loop, z[k : k + CHUNK]) for k in range(0, len(z), CHUNK)]
        threats, failed, avoidable, latest, slopes = (np.concatenate(rows) for rows in zip(*parts, strict=True))
        return Verdicts(threats, failed, avoidable, latest, slopes if slopes.size else None)

    def _chunk(self, program: Callable[..., Any], loop: LoopParams, z: np.ndarray) -> tuple[np.ndarray, ...]:
        """A chunk, padded with repeats of its last point."""
        n = len(z)
        full = jnp.asarray(np.concatenate([z, np.repeat(z[-1:], CHUNK - n, axis=0)]), float)
        met, back = _linearised(self.family, self.space, self.place, full)
        values, slopes, driven = _program(program)(
            loop, self.case, encounters=met, params=self.params, n_steps=self.steps
        )
        failed = np.any(np.asarray(driven.collision), axis=1)
        oracle = _never(CHUNK)
        if failed[:n].any():
            oracle = _program(_avoided, n_steps=False)(loop, self.case, driven=driven, onset=met.onset)
        avoidable = failed & np.asarray(oracle.avoidable)
        by_z = np.asarray(back(slopes))[:n] if slopes is not None else np.zeros((n, 0))
        return np.asarray(values)[:n], failed[:n], avoidable[:n], np.asarray(oracle.latest)[:n], by_z


def arena(loop: LoopParams, family: Family, *, mode: str, temperature: float, params: ThreatParams) -> Arena:
    """A driver in a family. Raises ConfigError for a mode that there is not.

    Args: loop, with the driver; family; mode and temperature, of the relaxation of the stack in gradients; params,
    what counts as a threat.
    """
    relaxation = loop.stack.relaxation.replace(mode=mode, temperature=temperature)
    case, place = encounter_case(family, others=loop.sim.traffic, vehicle=loop.vehicle)
    return Arena(
        family=family,
        space=space(family.numbers, "*"),
        hard=as_arrays(loop),
        relaxed=as_arrays(loop.replace(stack=loop.stack.replace(relaxation=relaxation))),
        case=as_arrays(case),
        place=place,
        params=as_arrays(params),
        steps=steps_of(family.duration, float(loop.period)),
    )


def drive(loop: LoopParams, case: Case, *, encounter: Encounter, params: ThreatParams, n_steps: int) -> tuple:
    """The threat [] m of one drive, and what came of it (`EncounterDrive`).

    Args: loop, with the driver; case, before anybody meets; encounter; params, of the threat; n_steps.
    """
    limit = case.lanes.graph.speed_limit[case.start.traffic.link[0]]
    start = meet(case.start, encounter, limit=limit)
    now = begin(loop, case.course, start=start)
    _, log = unrolled(loop, case, now=now, n_steps=n_steps, step_clip=STEP_CLIP)
    seen = facts(log, case, vehicle=loop.vehicle)
    fault = jax.lax.stop_gradient(at_fault(seen, loop.vehicle).at_fault)
    return threat(seen, loop.vehicle, params=params), EncounterDrive(log, jnp.any(fault > 0, axis=1))


def _valued(loop: LoopParams, case: Case, *, encounters: Encounter, params: ThreatParams, n_steps: int) -> tuple:
    values, driven = jax.vmap(lambda one: drive(loop, case, encounter=one, params=params, n_steps=n_steps))(encounters)
    return values, None, driven


def _sloped(loop: LoopParams, case: Case, *, encounters: Encounter, params: ThreatParams, n_steps: int) -> tuple:
    def valued(one: Encounter) -> tuple:
        return drive(loop, case, encounter=one, params=params, n_steps=n_steps)

    (values, driven), slopes = jax.vmap(jax.value_and_grad(valued, has_aux=True))(encounters)
    return values, slopes, driven


def _avoided(loop: LoopParams, case: Case, *, driven: EncounterDrive, onset: Array) -> Avoidance:
    return jax.vmap(
        lambda one, since: avoidance(one.log, case, collision=one.collision, onset=since, vehicle=loop.vehicle)
    )(driven, onset)


def _linearised(
    family: Family, of: Space, place: EncounterPlace, z: Array
) -> tuple[Encounter, Callable[[Encounter], Array]]:
    """The encounters [N] at z [N, P], and what takes slopes by them to slopes by z."""
    base = as_arrays(family.numbers)

    def encounters(z: Array) -> Encounter:
        return jax.vmap(lambda one: family.encounter(of.params(one, base), place))(z)

    found, back = jax.vjp(encounters, z)
    return found, lambda slopes: back(slopes)[0]


@functools.cache
def _program(function: Callable, *, n_steps: bool = True) -> Callable:
    static = ("n_steps",) if n_steps else ()
    return jax.jit(function, static_argnames=static, compiler_options=compiler_options())


def _never(count: int) -> Avoidance:
    return Avoidance(jnp.zeros(count, bool), jnp.full(count, -jnp.inf))
