"""Injected failures: what the localizer says of itself while it is wrong, and how soon it is right again."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from experiments.common.district import World
from experiments.localize.track import Change, LocalizedTrack, LocalizerPrograms
from urbanjax.evaluation import statistics
from urbanjax.evaluation.statistics import WithInterval
from urbanjax.evaluation.whereabouts import LONG, WRONG, longest_unnoticed
from urbanjax.localization.types import Health, Sign
from urbanjax.registration.voxelmap import VoxelMap, without
from urbanjax.sim.scenarios.tour import Tour
from urbanjax.sim.scenery.scenery import Scenery, altered
from urbanjax.types import SHARE, ConfigError, field, host_record, pytree, static

KINDS = ("scan_loss", "map_gap", "wrong_map", "kidnapping")


@pytree
class FaultParams:
    """How large the failures are, and how many of each."""

    loss_time: float = 2.0  # s without scans
    gap_length: float = 50.0  # m of the course without a map
    # of what stands beside the road, changed since it was mapped
    altered_share: float = field(default=0.3, metadata=SHARE)
    kidnap: tuple[float, float] = (8.0, 30.0)  # m along the course, by which the vehicle is put ahead
    before: float = 3.0  # s of good localization
    after: float = 12.0  # s to recover in
    seeds: int = static(default=20, metadata={"range": (0, 1000)})


@host_record
class InjectedFault:
    """One failure on one stretch of the drive."""

    kind: str
    seed: int
    begin: int  # place in the track at which it begins
    end: int  # and ends
    track: LocalizedTrack

    @property
    def unnoticed(self) -> int:
        """The most scans in a row with a wrong pose that is called NORMAL."""
        return longest_unnoticed(self.track.distance, self.track.rows.health)

    @property
    def recovery(self) -> int | None:
        """Scans from the end of the failure until the pose is right and called NORMAL for good; None if never."""
        well = (self.track.distance < WRONG) & (self.track.rows.health == Health.NORMAL)
        if not well[-1]:
            return None
        bad = np.flatnonzero(~well)
        return int(max(bad[-1] + 1 - self.end, 0)) if len(bad) else 0


def checked(params: FaultParams, tour: Tour, period: float) -> None:
    """Raise ConfigError for failures that do not fit the drive."""
    low, high = (float(x) for x in params.kidnap)
    if not 0 < low <= high:
        raise ConfigError(f"'faults.kidnap' must rise from a positive distance, not {[low, high]}")
    needed, there = _longest(params, period), len(tour.time)
    if params.seeds and there <= needed:
        raise ConfigError(
            f"a failure needs {needed} scans, but the drive has {there}: raise 'world.stretch', lower 'faults.after' "
            "or set 'faults.seeds=0'"
        )


def _longest(params: FaultParams, period: float) -> int:
    """Scans that a failure may take, with what comes before and after it."""
    before, after, lasts = (round(float(x) / period) for x in (params.before, params.after, params.loss_time))
    return before + 2 * after + lasts


def inject(
    programs: LocalizerPrograms,
    params: FaultParams,
    seed: int,
    tick: Callable[[str], None],
    kinds: Sequence[str] = KINDS,
) -> list[InjectedFault]:
    """All failures, each on stretches of the drive drawn by seed."""
    period = float(programs.localizer.period)
    steps = [round(float(x) / period) for x in (params.before, params.after)]
    found = []
    for kind in kinds:
        for k in range(params.seeds):
            rng = np.random.default_rng([seed, KINDS.index(kind), k])
            found.append(_one(programs, params, kind, k, rng, *steps))
            tick(kind)
    return found


def _one(
    programs: LocalizerPrograms,
    params: FaultParams,
    kind: str,
    seed: int,
    rng: np.random.Generator,
    before: int,
    after: int,
) -> InjectedFault:
    tour, world = programs.world.tour, programs.world
    period = float(programs.localizer.period)
    station = np.asarray(tour.station)
    lasts = round(float(params.loss_time) / period)
    first = int(rng.integers(0, len(station) - _longest(params, period)))
    begin, index, change = before, list(range(first, first + before + lasts + after)), Change()
    end = begin + lasts
    if kind == "scan_loss":
        change = Change(lost=frozenset(range(begin, end)))
    elif kind == "map_gap":
        middle = first + before
        change = Change(map=gap(world, middle, float(params.gap_length)))
        reach = station[middle] + float(params.gap_length) / 2
        end = max(int(np.searchsorted(station, reach)) - first, begin + 1)
        begin = max(int(np.searchsorted(station, reach - float(params.gap_length))) - first, 0)
        index = list(range(first, first + end + after))
    elif kind == "wrong_map":
        begin, end = 0, len(index) - 1
        change = Change(surroundings=_changed(world.surroundings, float(params.altered_share), seed))
    else:
        low, high = (float(x) for x in params.kidnap)
        there = int(np.searchsorted(station, station[first + before] + rng.uniform(low, high)))
        index = [*range(first, first + before), *range(there, there + lasts + after)]
        end = begin + 1
    index = [k for k in index if k < len(station)]
    key = jax.random.fold_in(jax.random.key(7), 100 * seed + KINDS.index(kind))
    return InjectedFault(kind, seed, begin, end, programs.run(key, index, change))


def gap(world: World, step: int, length: float) -> VoxelMap:
    """The map without a slab of `length` m across the course at a step of the drive; of the same shapes."""
    points, ego = world.course.map, world.tour.ego
    if points is None:
        raise ValueError("the course has no map")
    return without(points, ego.position[step], heading=ego.heading[step], length=length)


def _changed(surroundings: Scenery, share: float, seed: int) -> Scenery:
    return jax.tree.map(jnp.asarray, altered(surroundings, share, seed=seed))


def roc(score: np.ndarray, wrong: np.ndarray) -> float | None:
    """Area under the receiver operating characteristic: the chance that a wrong one scores above a right one."""
    if wrong.all() or not wrong.any():
        return None
    from scipy.stats import mannwhitneyu

    above = mannwhitneyu(score[wrong], score[~wrong], method="asymptotic").statistic
    return float(above / (wrong.sum() * (~wrong).sum()))


def table(faults: list[InjectedFault], period: float) -> dict[str, list[Any]]:
    """One row per kind of failure."""
    rows: dict[str, list[Any]] = {
        name: []
        for name in (
            "failure",
            "drives",
            "wrong but NORMAL, longest [s]",
            "largest error while NORMAL [m]",
            "recovered",
            "recovery, median [s]",
            "recovery, longest [s]",
            "scans not NORMAL [%]",
        )
    }
    for kind in KINDS:
        some = [fault for fault in faults if fault.kind == kind]
        if not some:
            continue
        back = [period * fault.recovery for fault in some if fault.recovery is not None]
        normal = np.concatenate([f.track.distance[f.track.rows.health == Health.NORMAL] for f in some])
        health = np.concatenate([f.track.rows.health for f in some])
        values = (
            kind,
            len(some),
            period * max(fault.unnoticed for fault in some),
            float(normal.max(initial=0)),
            len(back),
            float(np.median(back)) if back else None,
            max(back, default=None),
            100 * float((health != Health.NORMAL).mean()),
        )
        for name, value in zip(rows, values, strict=True):
            rows[name].append(value)
    return rows


def unnoticed(faults: Sequence[InjectedFault], period: float) -> WithInterval:
    """The share of drives that were WRONG metres off while NORMAL for more than LONG s."""
    return statistics.rate([period * fault.unnoticed > LONG for fault in faults])


def detection(tracks: Sequence[LocalizedTrack]) -> dict[str, float | int | None]:
    """ROC-AUC of the detector and of Eq. 8, over all registrations of these tracks; wrong means WRONG metres off."""
    there = np.concatenate([track.rows.signs[:, Sign.SCAN] <= 1 for track in tracks])
    wrong = np.concatenate([track.registered > WRONG for track in tracks])[there]
    score = np.concatenate([track.rows.signs.max(1) for track in tracks])[there]
    literal = np.concatenate([track.rows.literal for track in tracks])[there]
    return {
        "registrations": len(wrong),
        "registrations_wrong": int(wrong.sum()),
        "detector_auc": roc(score, wrong),
        "literal_gate_auc": roc(literal, wrong),
        "literal_gate_fires": int((literal > 1).sum()),
        "detector_missed": int((wrong & (score <= 1)).sum()),
        "detector_false_alarms": int((~wrong & (score > 1)).sum()),
    }
