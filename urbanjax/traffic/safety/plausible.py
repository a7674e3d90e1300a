"""Whether tracks are in the units that they are said to be in: speed and heading held against the positions."""

import numpy as np

from urbanjax.types.errors import TrafficError

FACTOR = 1.25  # of the stated speed from that of the positions, as of logs
WINDOW = 1.0  # s over which both are compared
WINDOWS = 5  # that a track is divided into at least, where it can be
FEWEST = 3  # windows that a median says something of
FAR = 1.0  # m in a window: a vehicle with less stands
ASTRAY, AGREES = 0.5, 0.2  # rad, of a heading from the way: it is another, or the same
MOST_TURNS = 50.0  # rad that a heading may have counted up to, where nothing else speaks for it
SPEEDS = {"km/h": 3.6, "mph": 1 / 0.44704, "ft/s": 1 / 0.3048, "kn": 3600 / 1852, "cm/s": 100.0, "mm/s": 1000.0}


def check_units(position: np.ndarray, heading: np.ndarray, *, speed: np.ndarray, valid: np.ndarray, dt: float) -> None:
    """Raise TrafficError where a vehicle's speed or heading contradicts its positions, with what would fit.

    Args: position [T, V, 2] m; heading [T, V] rad; speed [T, V] m/s; valid [T, V], which vehicles are there; dt [s]
    between two times.
    """
    count = len(position)
    size = int(np.clip(np.ceil(WINDOW / dt), 1, max((count - 1) // WINDOWS, 1)))
    first, last = np.arange(0, count - size, size), np.arange(size, count, size)
    through = np.array([valid[a : b + 1].all(0) for a, b in zip(first, last, strict=True)]).reshape(-1, valid.shape[1])
    for v in range(valid.shape[1]):
        way = position[last, v] - position[first, v]
        distance = np.hypot(*way.T)
        moves = through[:, v] & (distance > FAR)
        if moves.sum() >= FEWEST:
            known = np.where(valid[:, v], np.abs(speed[:, v]), 0)
            along = np.concatenate([[0.0], np.cumsum(dt * (known[1:] + known[:-1]) / 2)])
            _check_speed(v, float(np.median(((along[last] - along[first]) / distance)[moves])))
            _check_heading(v, heading[(first + last) // 2, v][moves], np.arctan2(way[:, 1], way[:, 0])[moves])
        else:
            _check_turns(v, heading[valid[:, v], v])


def _check_speed(v: int, ratio: float) -> None:
    if 1 / FACTOR <= ratio <= FACTOR:
        return
    fits = [unit for unit, factor in SPEEDS.items() if abs(ratio / factor - 1) < 0.1]
    remedy = f"it looks like {' or '.join(fits)}" if fits else "position is in m, speed in m/s and dt in s"
    raise TrafficError(
        f"speed of vehicle {v} is {ratio:.3g} times that of its positions, off by more than a factor of {FACTOR:g}: "
        f"{remedy}"
    )


def _check_heading(v: int, heading: np.ndarray, ahead: np.ndarray) -> None:
    allowed = AGREES if np.abs(heading).max() > 2 * np.pi else ASTRAY
    if apart(heading, ahead) > allowed and apart(np.radians(heading), ahead) <= AGREES:
        raise TrafficError(f"heading of vehicle {v} looks like degrees: give it in rad (np.radians)")


def _check_turns(v: int, heading: np.ndarray) -> None:
    most = float(np.abs(heading).max(initial=0.0))
    if most > MOST_TURNS:
        raise TrafficError(f"heading of vehicle {v} is {most:.4g} rad, which looks like degrees: give it in rad")


def apart(heading: np.ndarray, ahead: np.ndarray) -> float:
    """Median angle [rad] between directions. Args: heading and ahead [w] rad."""
    off = heading - ahead
    return float(np.median(np.abs(np.arctan2(np.sin(off), np.cos(off)))))
