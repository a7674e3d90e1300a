"""What can be wrong with a log that was read without fault: frozen, stuck, repeated, interpolated, coarse."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from urbanjax.io.logs.record import VehicleLog
from urbanjax.io.logs.sampling import raw, resolution, roughness
from urbanjax.types import host_record, pytree, static


@pytree
class QualityParams:
    """Limits beyond which a log's verdict says so."""

    frozen_extent: float = static(default=0.5)  # m, diagonal of the middle 98 % of positions
    same: float = static(default=0.0, metadata={"range": (0.0, 1e3)})  # m: positions no further apart are one
    moving_speed: float = static(default=1.0)  # m/s


MIDDLE = (0.01, 0.99)  # quantiles of positions between which a log's extent is taken
STILL = 1e-6  # m/s, of a stated speed that says nothing
COARSE = 0.01  # m, step of positions from which it is worth a word
ABOUT = (-1.0, 1.0)  # s, around a sample, between which its way is taken

DEFAULT = QualityParams()


@host_record
class Quality:
    """Counts, sizes and a verdict about one log."""

    log: str  # its name
    samples: int
    duration: float  # s
    length: float  # m along its samples
    period: float  # s, median between samples
    longest_gap: float  # s between two samples
    resolution: float  # m, step of the grid that positions lie on; 0 where they lie on none
    roughness: float  # m, median distance of a raw sample from the cubic through its four neighbours in time
    interpolated: int  # samples that are not raw
    repeated: int  # samples at the position of the one before
    repeated_moving: int  # of these, while the vehicle moves
    tied: int  # samples at whose position there is another
    places: int  # different positions with more than one sample
    duplicated: int  # samples that equal the one before, also in time
    longest_stuck: float  # s at one position while it moves
    frozen: bool  # it never moves
    dead_speed: bool  # the stated speed is 0 although it moves
    verdict: str

    @property
    def interpolated_share(self) -> float:
        """Of all samples."""
        return self.interpolated / self.samples


def quality(log: VehicleLog, params: QualityParams = DEFAULT) -> Quality:
    """What can be said against a log, and in words.

    Whether the vehicle moves at a repeated position is told by the stated speed, or else by the positions around it.
    Args: log, as read.
    """
    period = np.diff(log.time)
    step = np.hypot(*np.diff(log.position, axis=0).T)
    again = step <= params.same
    held = stuck(log, params)
    low, high = np.quantile(log.position, MIDDLE, axis=0)
    frozen = float(np.hypot(*(high - low))) < params.frozen_extent
    counts = np.unique(log.position, axis=0, return_counts=True)[1]
    measured = raw(log)
    speed = np.abs(log.speed[np.isfinite(log.speed)]) if log.speed is not None else None
    found = Quality(
        log=log.name,
        samples=log.n,
        duration=float(log.time[-1] - log.time[0]),
        length=float(step.sum()),
        period=float(np.median(period)),
        longest_gap=float(period.max()),
        resolution=0.0 if frozen else resolution(log.position),
        roughness=roughness(log.take(measured)),
        interpolated=int((~measured).sum()),
        repeated=int((again & (period > 0)).sum()),
        repeated_moving=int(held.sum()),
        tied=int(counts[counts > 1].sum()),
        places=int((counts > 1).sum()),
        duplicated=int((again & (period <= 0)).sum()),
        longest_stuck=_longest(log.time, held[1:]),
        frozen=frozen,
        dead_speed=bool(not frozen and speed is not None and len(speed) and speed.max() <= STILL),
        verdict="",
    )
    return dataclasses.replace(
        found, verdict=_verdict(found, params, 0.0 if speed is None else float(speed.max(initial=0.0)))
    )


def _verdict(q: Quality, params: QualityParams, fastest: float) -> str:
    says = []
    if q.frozen:
        stated = f", although its speed is said to reach {fastest:.1f} m/s" if fastest > params.moving_speed else ""
        return f"frozen: no movement in {q.duration:.0f} s{stated}; leave it out"
    if q.dead_speed:
        says.append("the stated speed is 0 although it moves: ignore it")
    if q.repeated_moving:
        says.append(
            f"{q.repeated} samples repeat the position before, {q.repeated_moving} of them while it moves "
            f"(up to {q.longest_stuck:.1f} s at one place): ties for nearest neighbours"
        )
    if q.duplicated:
        says.append(f"{q.duplicated} samples are there twice")
    if q.interpolated:
        says.append(f"{100 * q.interpolated_share:.0f} % of the samples are interpolated: keep the raw ones only")
    if q.resolution > COARSE:
        says.append(f"positions in steps of {q.resolution:g} m")
    return "; ".join(says) or "nothing against it"


def _moving(log: VehicleLog, params: QualityParams) -> np.ndarray:
    """Which samples [n] the vehicle moves at: by the stated speed, or the way over two seconds about them."""
    around = [np.interp(log.time + lag, log.time, axis) for axis in log.position.T for lag in ABOUT]
    way = np.hypot(around[1] - around[0], around[3] - around[2])
    by_way = way > (ABOUT[1] - ABOUT[0]) * params.moving_speed
    if log.speed is None or not np.any(np.abs(np.nan_to_num(log.speed)) > STILL):
        return by_way
    return np.where(np.isfinite(log.speed), np.abs(log.speed) > params.moving_speed, by_way)


def _longest(time: np.ndarray, again: np.ndarray) -> float:
    """Longest time between samples at one position, s."""
    first = np.maximum.accumulate(np.where(np.concatenate([[True], ~again]), np.arange(len(time)), 0))
    return float((time - time[first]).max())


def stuck(log: VehicleLog, params: QualityParams = DEFAULT) -> np.ndarray:
    """Which samples [n] repeat the position of the one before while the vehicle moves.

    Args: log, as read.
    """
    again = np.hypot(*np.diff(log.position, axis=0).T) <= params.same
    return np.concatenate([[False], again & (np.diff(log.time) > 0)]) & _moving(log, params)


def coarseness(found: Sequence[Quality]) -> list[float]:
    """The roughness of each log over the median of all that move, which shows whose positions are coarser.

    Args: found, the quality of each log.
    """
    moving = [q.roughness for q in found if not q.frozen and np.isfinite(q.roughness)]
    usual = float(np.median(moving)) if moving else float("nan")
    return [q.roughness / usual if usual > 0 and not q.frozen else float("nan") for q in found]
