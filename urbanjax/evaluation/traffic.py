"""How the others drive: an axis of its own beside missions and drivers (host side)."""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from urbanjax.sim.agents import Traffic
from urbanjax.sim.log import Log
from urbanjax.sim.replay import Replay
from urbanjax.sim.world import SimParams, WorldState
from urbanjax.types import as_arrays

UNREACHABLE = 1e3  # m, that the ego would have to reach into a lane for somebody to care


def idm(rng: np.random.Generator, traffic: Traffic) -> Traffic:
    """All alike: they follow (IDM), keep their lane and yield. Args: rng; traffic [V], as the mission drew it."""
    return traffic


def mixed(rng: np.random.Generator, traffic: Traffic) -> Traffic:
    """Headway, wanted speed and politeness drawn for each; half of them change lanes. Args: rng; traffic [V]."""
    n = len(traffic.valid)
    return _with(
        traffic,
        headway=rng.uniform(0.7, 2.2, n),
        desired_speed=np.where(traffic.reacts, traffic.desired_speed * rng.uniform(0.8, 1.2, n), traffic.desired_speed),
        politeness=rng.uniform(0.0, 0.6, n),
        changes=(rng.random(n) < 0.5) & traffic.reacts,
    )


def assertive(rng: np.random.Generator, traffic: Traffic) -> Traffic:
    """Short headways, a fifth faster, all change lanes without a thought for others. Args: rng; traffic [V]."""
    return _with(
        traffic,
        headway=np.full(len(traffic.valid), 0.6),
        desired_speed=np.where(traffic.reacts, traffic.desired_speed * 1.2, traffic.desired_speed),
        politeness=np.zeros(len(traffic.valid)),
        changes=np.asarray(traffic.reacts),
    )


def non_yielding(rng: np.random.Generator, traffic: Traffic) -> Traffic:
    """As `idm` among each other, but nobody brakes for the ego or yields to it. Args: rng; traffic [V]."""
    return traffic


def replay(rng: np.random.Generator, traffic: Traffic) -> Traffic:
    """All move as they did when an IDM driver was in the ego's place, whatever it does. Args: rng; traffic [V]."""
    return traffic


MANNERS: dict[str, Callable[[np.random.Generator, Traffic], Traffic]] = {
    "idm": idm,
    "mixed": mixed,
    "assertive": assertive,
    "non_yielding": non_yielding,
    "replay": replay,
}


def mannered(world: WorldState, name: str, *, seed: int) -> WorldState:
    """The world with traffic of that manner. Args: world; name, in MANNERS; seed, of what is drawn for each driver."""
    rng = np.random.default_rng([list(MANNERS).index(name), seed])
    return dataclasses.replace(world, traffic=MANNERS[name](rng, world.traffic))


def as_recorded(world: WorldState, log: Log, *, period: float) -> WorldState:
    """The world in which everybody moves as in a log of it. Args: world; log [T], of one run of it; period [s]."""
    them = log.traffic
    rows: dict[str, Any] = {name: getattr(them, name) for name in ("position", "heading", "speed", "valid")}
    rows |= {name: getattr(them, name)[0] for name in ("length", "width")}
    kind = np.zeros(them.valid.shape[1], np.int32) if them.kind is None else np.asarray(them.kind)[0]
    recorded = Replay(**rows, **as_arrays({"period": period, "kind": kind}))
    nobody = dataclasses.replace(world.traffic, valid=np.zeros_like(world.traffic.valid))
    return dataclasses.replace(world, traffic=nobody, replay=jax.device_get(recorded))


def mannered_sim(sim: SimParams, name: str) -> SimParams:
    """The simulator for traffic of that manner. Args: sim; name, in MANNERS."""
    if name != "non_yielding":
        return sim
    return dataclasses.replace(sim, reaction=dataclasses.replace(sim.reaction, margin=UNREACHABLE))


def _with(traffic: Traffic, **columns: Any) -> Traffic:
    now = {name: np.asarray(getattr(traffic, name)) for name in columns}
    return dataclasses.replace(
        traffic, **{name: np.asarray(column, now[name].dtype) for name, column in columns.items()}
    )
