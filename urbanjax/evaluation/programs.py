"""What a chunk of C drives goes through, each function a program of its own: begun, driven on, judged."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from urbanjax import stack
from urbanjax.drivers import PdmDriver
from urbanjax.evaluation.case import Case
from urbanjax.evaluation.facts import ROUNDING, at_goal, facts
from urbanjax.evaluation.scores import epdms_windows
from urbanjax.evaluation.verdict import judge
from urbanjax.evaluation.whereabouts import Whereabouts
from urbanjax.numerics.compiling import compiler_options
from urbanjax.rollout import LoopParams, Underway, begin, go_on
from urbanjax.sim import world
from urbanjax.sim.log import Log
from urbanjax.types import ConfigError, as_arrays

SEGMENT = 50  # steps between two looks at who is still driving
SEARCH = 10  # steps between two looks at who is lost; a part of the former


@functools.cache
def compiled(function: Callable) -> Callable:
    """The function as a program; made when it is needed, since its options depend on the device. Args: function."""
    return jax.jit(function, compiler_options=compiler_options())


def _own(loop: LoopParams, case: Case) -> LoopParams:
    """The loop with the vehicle of a drive."""
    return loop if case.vehicle is None else loop.replace(vehicle=case.vehicle)


def _driven(loop: LoopParams, case: Case) -> LoopParams:
    """The loop with the vehicle of a drive, and with the localizer that it asks for."""
    if case.sensing is not None:
        if loop.driver is not None:
            raise ConfigError("only the stack finds its pose from scans; ask such missions of no other driver")
        loop = loop.replace(stack=loop.stack.replace(localizer="lidar"))
    return _own(loop, case)


def _each(function: Callable[..., Any], loops: LoopParams, *, cases: Case, now: Underway) -> Any:
    """The function of every drive; those on scans one after the other, so that only who is lost is searched for."""
    if cases.sensing is None:
        return jax.vmap(function)(loops, cases, now)
    return jax.lax.map(lambda drive: function(*drive), (loops, cases, now))


def fresh(loops: LoopParams, cases: Case) -> Underway:
    """The loops [C] before their first step. Args: loops [C], with the driver; cases [C]."""

    def one(loop: LoopParams, case: Case) -> Underway:
        return begin(_driven(loop, case), case.course, start=case.start, sensing=case.sensing)

    return jax.vmap(one)(loops, cases)


def renewed(now: Underway, begun: Underway, *, new: jax.Array) -> Underway:
    """The loops [C], some of them begun anew. Args: now; begun, `fresh` ones; new [C] bool, which of them to take."""
    return jax.tree.map(lambda a, b: jnp.where(new.reshape(-1, *[1] * (a.ndim - 1)), b, a), now, begun)


def segment(loops: LoopParams, cases: Case, *, now: Underway) -> tuple[Underway, Log, jax.Array, Whereabouts | None]:
    """`SEGMENT` steps of all, which of them are still driving, and where those on scans believe to be.

    Args: loops [C]; cases [C]; now, the loops [C].
    """

    def one(loop: LoopParams, case: Case, now: Underway) -> tuple[Underway, Log, jax.Array, Whereabouts | None]:
        own = _driven(loop, case)
        after, log, believed = _on(own, case, now=now)
        seen = facts(log, case, vehicle=own.vehicle)
        late = after.world.time - case.start.time > case.limit + ROUNDING
        return after, log, ~jnp.any(at_goal(log, case, station=seen.station, ego=seen.ego)) & ~late, believed

    return _each(one, loops, cases=cases, now=now)


def _on(own: LoopParams, case: Case, *, now: Underway) -> tuple[Underway, Log, Whereabouts | None]:
    """`SEGMENT` steps of one."""
    if case.sensing is None:
        after, (log, _) = go_on(own, case.course, lanes=case.lanes, now=now, n_steps=SEGMENT, keep=_nothing)
        return after, log, None

    def some(now: Underway, _: None) -> tuple[Underway, tuple[Log, Any]]:
        now = _searched(own, case, now)
        return go_on(
            own, case.course, lanes=case.lanes, now=now, n_steps=SEARCH, keep=_localization, sensing=case.sensing
        )

    after, parts = jax.lax.scan(some, now, length=SEGMENT // SEARCH)
    log, found = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), parts)
    return after, log, Whereabouts.of(found, log.ego)


def searched(loops: LoopParams, cases: Case, *, now: Underway) -> Underway:
    """The loops [C], with the poses found anew of those that are lost: due every `SEARCH` steps.

    Args: loops [C]; cases [C]; now, the loops [C].
    """

    def one(loop: LoopParams, case: Case, now: Underway) -> Underway:
        return _searched(_driven(loop, case), case, now)

    return _each(one, loops, cases=cases, now=now)


def _searched(own: LoopParams, case: Case, now: Underway) -> Underway:
    if case.sensing is None:
        return now
    driver, sim = own.handed_down()
    seen = world.observe(sim, case.lanes, world=now.world, sensing=case.sensing)
    return now.replace(state=stack.recover(driver, case.course, state=now.state, observation=seen))


def one_step(loops: LoopParams, cases: Case, *, now: Underway) -> tuple[Underway, Any]:
    """One step of all, and what the driver says of it. Args: loops [C]; cases [C]; now, the loops [C]."""

    def one(loop: LoopParams, case: Case, now: Underway) -> tuple[Underway, Any]:
        own = _driven(loop, case)
        after, (_, info) = go_on(
            own, case.course, lanes=case.lanes, now=now, n_steps=1, keep=_all, sensing=case.sensing
        )
        return after, jax.tree.map(lambda x: x[0], info)

    return _each(one, loops, cases=cases, now=now)


def references(loops: LoopParams, cases: Case, *, now: Underway) -> Log:
    """What `pdm` as it stands would do from here on in the place of each driver, logs [C, 41] of a window of the EPDMS.

    Args: loops [C]; cases [C]; now, the loops [C].
    """
    pdm = as_arrays(PdmDriver())

    def one(loop: LoopParams, case: Case, now: Underway) -> Log:
        own = _own(loop.replace(driver=pdm), case)
        its = begin(own, case.course, start=now.world)
        _, (log, _) = go_on(own, case.course, lanes=case.lanes, now=its, n_steps=epdms_windows.STEPS, keep=_nothing)
        return log

    return jax.vmap(one)(loops, cases, now)


def columns(loops: LoopParams, cases: Case, *, logs: Log) -> dict[str, jax.Array]:
    """All that is said of the drives, columns [C]. Args: loops [C]; cases [C]; logs [C, T], of whole drives."""

    def one(loop: LoopParams, case: Case, log: Log) -> dict[str, jax.Array]:
        vehicle = _own(loop, case).vehicle
        return judge(facts(log, case, vehicle=vehicle), vehicle)

    return jax.vmap(one)(loops, cases, logs)


def epdms_columns(loops: LoopParams, cases: Case, *, logs: Log, theirs: Log) -> dict[str, jax.Array]:
    """What the EPDMS says of the drives, columns [C]; a window begins with each segment.

    Args: loops [C]; cases [C]; logs [C, T], of whole drives; theirs [C, K, 41], the `references` of each segment.
    """

    def one(loop: LoopParams, case: Case, log: Log, theirs: Log) -> dict[str, jax.Array]:
        vehicle = _own(loop, case).vehicle
        endless = dataclasses.replace(
            case, goal=jnp.full_like(case.goal, jnp.inf), limit=jnp.full_like(case.limit, jnp.inf), aim=None
        )
        found = epdms_windows.driven(
            facts(log, case, vehicle=vehicle),
            vehicle,
            references=jax.vmap(lambda log: facts(log, endless, vehicle=vehicle))(theirs),
            every=SEGMENT,
        )
        values = {spec.name: getattr(found.mean, spec.name) for spec in dataclasses.fields(found.mean)}
        return {f"epdms_driven_{name}": value for name, value in (values | {"windows": found.windows}).items()}

    return jax.vmap(one)(loops, cases, logs, theirs)


def _nothing(info: Any) -> None:
    return None


def _all(info: Any) -> Any:
    return info


def _localization(info: Any) -> Any:
    return info.localization.replace(info=info.localization.info.dropped)
