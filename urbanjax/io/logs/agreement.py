"""Speed and heading as a log states them, held against its positions and times."""

import dataclasses

import numpy as np

from urbanjax.io.logs.format import ANGLE, LogFormat, fitting
from urbanjax.io.logs.record import LogError, VehicleLog
from urbanjax.traffic.safety.plausible import AGREES, ASTRAY, apart

WINDOW = 1.0  # s over which speeds are compared
TYPICAL = 0.9  # quantile of distances that a moving vehicle's are held against
MOVING = 0.3  # of the 90 % quantile of distances: windows with less do not count
ANY_WAY = 1e-6  # m in a window: less is rounding
FAR_ENOUGH = 1.0  # m in a window, from which its direction counts
FEWEST = 3  # windows that a median says something of
QUARTERS, WINDOWS = 4, 5  # parts of a log that are looked at one by one; windows that it has at least
STILL = 1e-6  # m/s, of a stated speed that says nothing


def compared(log: VehicleLog, form: LogFormat, *, column: str) -> VehicleLog:
    """The log with the ratio of its stated speed to that of its positions, and notes of what does not agree.

    Args: log, with its speed and heading as stated; form, the file's format; column of the speed, for messages. Raises
    LogError where the ratio is off by more than the format's factor, or the heading from the way and not if it were in
    another unit or sense, with the settings that would fit.
    """
    notes = [*log.report.notes, *_astray(log, form)]
    ratio = float("nan")
    if log.speed is not None:
        at, ratios = speed_ratios(log)
        if len(ratios):
            ratio = _checked(log, float(np.median(ratios)), form, column)
            notes += _uneven(log, form, at, ratios)
        else:
            still = bool(np.all(np.nan_to_num(np.abs(log.speed)) <= STILL))
            notes.append("the stated speed " + ("is 0 throughout" if still else "could not be compared with positions"))
    return dataclasses.replace(log, report=dataclasses.replace(log.report, speed_ratio=ratio, notes=tuple(notes)))


def _checked(log: VehicleLog, ratio: float, form: LogFormat, column: str) -> float:
    """The ratio, if it is not off by more than the format's factor."""
    if not 1 / form.speed_factor <= ratio <= form.speed_factor:
        settings = fitting(form, ratio)
        remedy = f"; it looks like {' or '.join(settings)}" if settings else "; no other unit explains it"
        raise LogError(
            f"{log.source}: column {column!r}: the stated speed of {log.name} is {ratio:.3g} times that of its "
            f"positions, off by more than a factor of {form.speed_factor:g} (speed_factor){remedy}"
        )
    return ratio


def _uneven(log: VehicleLog, form: LogFormat, at: np.ndarray, ratios: np.ndarray) -> list[str]:
    """Notes of the quarters of a log whose speed is in another unit, or wrong."""
    notes = []
    for part in np.array_split(np.arange(len(ratios)), QUARTERS):
        ratio = float(np.median(ratios[part])) if len(part) >= FEWEST else 1.0
        if not 1 / form.speed_factor**2 <= ratio <= form.speed_factor**2:
            first, last = np.asarray(log.rows)[at[part[[0, -1]]]]
            notes.append(f"rows {first} to {last}: the stated speed is {ratio:.3g} times that of the positions")
    return notes


def speed_ratios(log: VehicleLog) -> tuple[np.ndarray, np.ndarray]:
    """First samples [w] of windows of about WINDOW, and stated speed over distance per time [w] in them.

    Only those count in which the vehicle moves by both; there are none where there would be fewer than three.
    Args: log, with its speed as stated.
    """
    none = np.zeros(0, int), np.zeros(0)
    step = np.diff(log.time)
    at = np.arange(0, log.n, _size(log))
    if log.speed is None or len(at) < 4:
        return none
    speed = np.abs(log.speed)
    known = np.nan_to_num(speed)
    stated = np.concatenate([[0.0], np.cumsum(step * (known[1:] + known[:-1]) / 2)])
    # Windows with an absent speed do not count.
    lost = np.concatenate([[0], np.cumsum(~np.isfinite(speed))])
    whole = lost[np.minimum(at[1:] + 1, log.n)] == lost[at[:-1]]
    distance = np.hypot(*np.diff(log.position[at], axis=0).T)
    way = np.diff(stated[at])
    moving = whole & (distance > max(MOVING * float(np.quantile(distance, TYPICAL)), ANY_WAY)) & (way > STILL)
    return (at[:-1][moving], way[moving] / distance[moving]) if moving.sum() >= FEWEST else none


def _astray(log: VehicleLog, form: LogFormat) -> list[str]:
    """A note where the stated heading is not that of the way; an error where it is in another unit or sense."""
    if log.heading is None:
        return []
    size = _size(log)
    first, last = np.arange(0, log.n - size, size), np.arange(size, log.n, size)
    way = log.position[last] - log.position[first]
    distance = np.hypot(*way.T)
    moving = np.isfinite(log.heading[(first + last) // 2]) & (distance > FAR_ENOUGH)
    if moving.sum() < FEWEST:
        return []
    ahead = np.arctan2(way[:, 1], way[:, 0])[moving]
    heading = log.heading[(first + last) // 2][moving]
    angle = apart(heading, ahead)
    # Beyond a turn it is likely to be in another unit, which may by chance come near.
    if angle <= (AGREES if np.abs(heading).max() > 2 * np.pi else ASTRAY):
        return []
    as_stated = (np.pi / 2 - heading if form.units.compass else heading) / ANGLE[form.units.heading]
    for unit, scale in ANGLE.items():
        for compass in (form.units.compass, not form.units.compass):
            turned = np.pi / 2 - as_stated * scale if compass else as_stated * scale
            if apart(turned, ahead) <= AGREES:
                settings = [f"units.heading={unit}"] if unit != form.units.heading else []
                settings += [f"units.compass={str(compass).lower()}"] if compass != form.units.compass else []
                raise LogError(
                    f"{log.source}: column {form.columns.heading!r}: the stated heading of {log.name} is {angle:.2f} "
                    f"rad from its way (median); it looks like {' and '.join(settings)}"
                )
    if angle <= ASTRAY:
        return []
    return [f"the stated heading is {angle:.2f} rad from the way (median): see units.heading and units.compass"]


def _size(log: VehicleLog) -> int:
    """Samples in a window, of which the log has five or more if it can."""
    return int(np.clip(np.ceil(WINDOW / np.median(np.diff(log.time))), 1, max((log.n - 1) // WINDOWS, 1)))
