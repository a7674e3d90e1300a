"""Searches for the failures of drivers at equal rollouts, and what of it is confirmed by the evaluation."""

from collections.abc import Callable
from typing import Any

import numpy as np

from experiments.tune.adversary.task import AdversaryTask
from urbanjax.drivers import DRIVERS
from urbanjax.evaluation import statistics
from urbanjax.evaluation.batch import Job, Outcome, outcomes
from urbanjax.evaluation.missions.found import FoundScene, found_missions
from urbanjax.evaluation.statistics import WithInterval
from urbanjax.rollout import LoopParams
from urbanjax.sim.scenarios.encounter_families import FAMILIES
from urbanjax.tuning.adversary import Arena, Hunt, Trial, arena, distinct, hunt
from urbanjax.tuning.adversary.hunt import SEARCHES
from urbanjax.types import host_record

OURS = ("gradient", "values")


@host_record
class Quarry:
    """All hunts for one driver in one family."""

    driver: str
    arena: Arena
    price: float  # of a gradient, in rollouts
    hunts: tuple[Hunt, ...]

    @property
    def family(self) -> str:
        """Its name."""
        return self.arena.family.name

    def of(self, search: str) -> list[Hunt]:
        """Those of one search, by seed. Args: search."""
        return [one for one in self.hunts if one.search == search]

    def counts(self, search: str) -> list[int]:
        """Distinct avoidable failures that each seed of a search found. Args: search."""
        return [len(distinct(self.arena, one.failures)) for one in self.of(search)]

    def trials(self, kind: str) -> list[Trial]:
        """The distinct ones over all searches. Args: kind, "failures" or "unavoidable"."""
        return distinct(self.arena, [trial for one in self.hunts for trial in getattr(one, kind)])


def loop_of(loop: LoopParams, driver: str) -> LoopParams:
    """The closed loop of one driver. Args: loop, of the stack; driver, its name."""
    if driver == "stack":
        return loop
    own = {"stack": loop.stack} if driver == "blind" else {}
    return loop.replace(driver=DRIVERS[driver](**own))


def pursue(loop: LoopParams, task: AdversaryTask, *, tick: Callable[..., None]) -> list[Quarry]:
    """All hunts. Args: loop, of the stack; task; tick, told what goes on."""
    found, steps = [], len(task.drivers) * len(task.families) * len(SEARCHES) * task.seeds
    done = 0
    for driver in task.drivers:
        for name in task.families:
            tick(f"{driver}, {name}: compiling", done / steps)
            where = arena(
                loop_of(loop, driver),
                FAMILIES[name],
                mode=task.mode,
                temperature=float(task.temperature),
                params=task.threat,
            )
            price, hunts = where.cost_of_gradient(), []
            for search in SEARCHES:
                for seed in range(task.seed, task.seed + task.seeds):
                    tick(f"{driver}, {name}: {search}, seed {seed}", done / steps)
                    hunts.append(hunt(where, search, seed=seed, budget=task.budget, cost_of_gradient=price))
                    done += 1
            found.append(Quarry(driver, where, price, tuple(hunts)))
    return found


def counted(quarries: list[Quarry]) -> dict[str, list[Any]]:
    """The table of failures by driver, family and search, with 95 % bootstrap intervals over seeds."""
    rows = []
    for one in quarries:
        for search in SEARCHES:
            hunts = one.of(search)
            rows.append(
                {
                    "driver": one.driver,
                    "family": one.family,
                    "search": search,
                    "distinct avoidable failures": statistics.mean(one.counts(search)).text(),
                    "avoidable failures": sum(len(x.failures) for x in hunts),
                    "unavoidable": sum(len(x.unavoidable) for x in hunts),
                    "points tried": sum(len(x.trials) for x in hunts),
                    "of them with gradient": sum(trial.sloped for x in hunts for trial in x.trials),
                    "gradients not finite": sum(trial.broken for x in hunts for trial in x.trials),
                    "a gradient costs": one.price,
                }
            )
    return {name: [row[name] for row in rows] for name in rows[0]}


def ratio(quarries: list[Quarry], driver: str, *, ours: str, against: str) -> WithInterval:
    """How many times as many distinct failures a search found, seeds paired and drawn with replacement.

    Args: quarries; driver; ours, the search; against, the other one. NaN where that one found none.
    """
    own = [one for one in quarries if one.driver == driver]
    found, others = (np.sum([one.counts(search) for one in own], axis=0) for search in (ours, against))

    def quotient(which: np.ndarray) -> float:
        return float(found[which].sum() / others[which].sum()) if others[which].sum() else np.nan

    return statistics.bootstrap(quotient, len(found))


def scenes(quarries: list[Quarry], driver: str) -> list[FoundScene]:
    """The distinct avoidable failures of a driver, as what a file holds. Args: quarries; driver."""
    return [
        FoundScene(one.family, one.arena.numbers(trial.z))
        for one in quarries
        if one.driver == driver
        for trial in one.trials("failures")
    ]


def confirmed(loop: LoopParams, found: list[FoundScene], *, logs: bool = True) -> list[Outcome]:
    """What the evaluation says of found scenes, driven once more by the program of all missions.

    Args: loop, with the driver; found; logs, whether they are kept.
    """
    jobs = [Job(mission, k) for mission in found_missions(found) for k in range(mission.count)]
    return list(outcomes(loop, jobs, logs=logs)) if jobs else []


def confirmation(driver: str, driven: list[Outcome]) -> dict[str, Any]:
    """How many of the found scenes fail there too, as entries of a summary. Args: driver; driven, by `confirmed`."""
    hits = [bool(one.row["competition_at_fault"]) for one in driven]
    return {
        f"{driver}_found": len(hits),
        f"{driver}_confirmed": sum(hits),
        **statistics.rate(hits).percent.flat(f"{driver}_confirmed_percent"),
    }
