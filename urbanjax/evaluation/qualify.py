"""How good a driver is, in one call (host side)."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from urbanjax.evaluation.batch import Job, outcomes
from urbanjax.evaluation.missions import MISSIONS, QUALIFICATION
from urbanjax.evaluation.missions.localized import GIVEN, LOCALIZATIONS, LocalizedMission, Roads
from urbanjax.evaluation.traffic import MANNERS
from urbanjax.evaluation.verdict import Cause
from urbanjax.rollout import LoopParams
from urbanjax.types import ConfigError
from urbanjax.types.arguments import kind, short, whole


def qualify(
    driver: Any = None,
    *,
    missions: Sequence[str] = tuple(mission.name for mission in QUALIFICATION),
    seeds: int = 16,
    traffic: str = "idm",
    localization: str = GIVEN,
    params: LoopParams | Sequence[LoopParams] | None = None,
) -> dict[str, np.ndarray]:
    """Drives of a driver in every mission, as columns [N] with one entry for each drive.

    Among them `mission`, `seed`, `success`, `cause` (what it failed by), `nuplan_total`, `carla_total`,
    `commonroad_total`, `competition_total` and what these are made of. `evaluation.statistics` gives intervals.
    Args: driver, any pytree with `init` and `step` (see `drivers.protocol`; None: the stack of params); missions,
    names in `evaluation.missions.MISSIONS`; seeds, drives of each, of the seeds from 0; traffic, how the others drive
    (a name in `evaluation.traffic.MANNERS`); localization, how the stack knows where it is ("given", or a name in
    `evaluation.missions.localized.LOCALIZATIONS`); params, of the closed loop, or several sets of them that differ in
    values alone: all are driven by one program, and the column `params` counts them from 0. Raises ConfigError for
    names that there are not, for what is no driver, and for sets that no one program holds.
    """
    params = LoopParams() if params is None else params
    sets = params if isinstance(params, Sequence) else [params]
    for one in sets:
        kind(one, "params", wanted=LoopParams, error=ConfigError)
    whole(seeds, "seeds", error=ConfigError, least=1)
    if driver is not None and not all(callable(getattr(driver, name, None)) for name in ("init", "step")):
        raise ConfigError(f"driver is {driver!r}: it needs init(course, pose) and step(course, state, observation)")
    if not isinstance(missions, Sequence) or not missions:
        raise ConfigError(f"missions is {missions!r}: give names, such as {QUALIFICATION[0].name!r}")
    names = [missions] if isinstance(missions, str) else list(missions)
    known = [*((name, MISSIONS) for name in names), (traffic, MANNERS), (localization, (GIVEN, *LOCALIZATIONS))]
    for asked, there in known:
        if not isinstance(asked, str) or asked not in there:
            raise ConfigError(f"{short(asked)} is none of {', '.join(there)}")
    chosen = [MISSIONS[name] for name in names]
    if localization != GIVEN and sets:
        roads = Roads(sets[0].sensor)
        chosen = [LocalizedMission(one, localization, roads) for one in chosen]
    loops = sets if driver is None else [one.replace(driver=driver) for one in sets]
    jobs = [Job(mission, seed, k) for mission in chosen for seed in range(seeds) for k in range(len(sets))]
    found = outcomes(loops, jobs, traffic=traffic)
    rows = [{**one.row, "cause": Cause(int(one.row["cause"])).label} for one in found]
    if isinstance(params, Sequence):
        rows = [{**row, "params": job.params} for row, job in zip(rows, jobs, strict=True)]
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}
