"""Logs on an even clock or at even stations, never across a gap."""

import dataclasses

import numpy as np

from urbanjax.io.logs.line import moved
from urbanjax.io.logs.record import LogError, VehicleLog
from urbanjax.io.logs.sampling import raw
from urbanjax.types import host_record

MOST = 5_000_000  # samples of a result
ROUNDING = 1e-9  # of a step (a gap, m): within it a value is at the place


@host_record
class Resampled:
    """A log on an even grid in one piece or more; between two pieces lies a gap, of which nothing is known."""

    log: VehicleLog  # its rows are those of the samples just before
    piece: np.ndarray  # [n] int, the piece of each sample, from 0
    index: (
        np.ndarray
    )  # [n] int, place on the grid: of time, counted from the clock's 0 s; of stations, within its piece
    gaps: int  # longer than the stated duration
    gap_time: float  # s in them
    interpolated: int  # samples that were left out as not raw
    standing: int  # samples that were left out as standing still
    single: int  # samples that were left out because no other was near, or no grid point between them

    @property
    def station(self) -> np.ndarray:
        """Way [n] from the beginning of each piece to its samples, m along the resampled log."""
        step = np.hypot(*np.diff(self.log.position, axis=0, prepend=self.log.position[:1]).T)
        way = np.cumsum(np.where(np.diff(self.piece, prepend=-1) != 0, 0.0, step))
        first = np.concatenate([[True], np.diff(self.piece) != 0])
        return way - np.maximum.accumulate(np.where(first, way, 0.0))

    def pieces(self) -> list[VehicleLog]:
        """One log per piece."""
        return [self.log.take(self.piece == k) for k in np.unique(self.piece)]


def by_time(log: VehicleLog, period: float, *, longest_gap: float = 1.0, raw_only: bool = False) -> Resampled:
    """The log at the multiples of `period` (s), so that logs of one clock share their times; linear in between.

    Heading takes the short way round the circle.
    Args: log, as read; period [s]; longest_gap, s without a sample that is still crossed; raw_only, leave interpolated
    samples out first. Raises LogError for a period that is not positive, for one that makes too many samples and where
    no piece has two.
    """
    used, interpolated = _usable(log, raw_only)
    _positive(period=period, longest_gap=longest_gap)
    _bounded((used.time[-1] - used.time[0]) / period, log)
    found = []
    for part in _parts(used, longest_gap):
        first, last = np.ceil(part.time[0] / period - ROUNDING), np.floor(part.time[-1] / period + ROUNDING)
        index = np.arange(first, last + 1)
        found.append((part, index.astype(int), np.clip(index * period, part.time[0], part.time[-1]), part.time))
    made = _joined(log, used, found, longest_gap, interpolated, 0)
    # Clipping moved no sample by more than rounding; the clock is exact again.
    return dataclasses.replace(made, log=dataclasses.replace(made.log, time=made.index * period))


def by_length(
    log: VehicleLog, spacing: float, *, longest_gap: float = 1.0, standing: float = 0.2, raw_only: bool = False
) -> Resampled:
    """The log at every `spacing` (m) along its own way, from the beginning of each piece; linear in between.

    Samples that are less than `standing` (m) from the one kept before are left out first, so that noise at a
    standstill is no way. A gap is one of the log, not of what standing leaves. Errors as of `by_time`.
    Args: log, as read; spacing [m]; longest_gap, s without a sample that is still crossed; standing [m]; raw_only,
    leave interpolated samples out first.
    """
    used, interpolated = _usable(log, raw_only)
    _positive(spacing=spacing, longest_gap=longest_gap)
    found, still = [], 0
    for part in _parts(used, longest_gap):
        kept = moved(part.position, max(standing, ROUNDING))
        still += int((~kept).sum())
        part = part.take(kept)
        way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(part.position, axis=0).T))])
        _bounded(way[-1] / spacing, log)
        index = np.arange(int(np.floor(way[-1] / spacing + ROUNDING)) + 1)
        found.append((part, index, np.minimum(index * spacing, way[-1]), way))
    return _joined(log, used, found, longest_gap, interpolated, still)


def _usable(log: VehicleLog, raw_only: bool) -> tuple[VehicleLog, int]:
    if not raw_only:
        return log, 0
    which = raw(log)
    if which.sum() < 2:
        raise LogError(f"{log.source}: log {log.name}: fewer than two samples are raw")
    return log.take(which), int((~which).sum())


def _positive(**values: float) -> None:
    for name, value in values.items():
        if not 0.0 < value < np.inf:
            raise LogError(f"resampling: {name} must be positive, not {value}")


def _bounded(count: float, log: VehicleLog) -> None:
    if not count < MOST:
        raise LogError(
            f"{log.source}: log {log.name}: would have {count:.3g} samples, more than {MOST}; take larger steps"
        )


def _parts(log: VehicleLog, longest_gap: float) -> list[VehicleLog]:
    cuts = np.flatnonzero(np.diff(log.time) > longest_gap * (1 + ROUNDING)) + 1
    return [log.take(which) for which in np.split(np.arange(log.n), cuts)]


def _joined(
    log: VehicleLog,
    used: VehicleLog,
    found: list[tuple[VehicleLog, np.ndarray, np.ndarray, np.ndarray]],
    longest_gap: float,
    interpolated: int,
    standing: int,
) -> Resampled:
    """The pieces, each of a part of the log, grid indices and values of them, and those values at its samples."""
    whole = [item for item in found if item[0].n > 1 and len(item[1]) > 1]
    if not whole:
        raise LogError(
            f"{log.source}: log {log.name}: no piece has two samples; take smaller steps or a longer longest_gap"
        )
    parts = [_at(part, at, known) for part, _, at, known in whole]
    step = np.diff(used.time)
    gaps = step[step > longest_gap * (1 + ROUNDING)]

    def joined(name: str) -> np.ndarray | None:
        values = [getattr(part, name) for part in parts]
        return None if values[0] is None else np.concatenate(values)

    arrays = {name: joined(name) for name in ("time", "position", "speed", "heading", "rows")}
    return Resampled(
        log=dataclasses.replace(log, **arrays),
        piece=np.repeat(np.arange(len(parts)), [part.n for part in parts]),
        index=np.concatenate([index for _, index, _, _ in whole]),
        gaps=len(gaps),
        gap_time=float(gaps.sum()),
        interpolated=interpolated,
        standing=standing,
        single=sum(part.n for part, *_ in found) - sum(part.n for part, *_ in whole),
    )


def _at(log: VehicleLog, at: np.ndarray, known: np.ndarray) -> VehicleLog:
    """The log where a rising quantity, `known` at its samples, has the values `at` [k]."""
    before = np.clip(np.searchsorted(known, at, side="right") - 1, 0, log.n - 1)
    heading = None
    if log.heading is not None:
        turned, given = np.full(log.n, np.nan), np.isfinite(log.heading)
        turned[given] = np.unwrap(log.heading[given])
        heading = np.interp(at, known, turned)
        heading = np.arctan2(np.sin(heading), np.cos(heading))
    return dataclasses.replace(
        log,
        time=np.interp(at, known, log.time),
        position=np.stack([np.interp(at, known, axis) for axis in log.position.T], -1),
        speed=None if log.speed is None else np.interp(at, known, log.speed),
        heading=heading,
        rows=np.asarray(log.rows)[before],
    )
