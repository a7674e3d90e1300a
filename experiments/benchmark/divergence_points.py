"""Points on which estimates of the divergence are timed: a cloud, and laps of a course."""

import numpy as np

LAPS, LENGTH = 9, 5000.0  # m
APART, SWAY = 0.5, 0.3  # m: standard deviation of the offsets of laps; amplitude of each wave of their wander
WAVES = (3, 11, 37)  # in a lap


def gaussian(teams: int, n: int, rng: np.random.Generator) -> np.ndarray:
    """Points [T, n, 2] (m) around the origin; standard deviations from 1 of the first team to 2 of the last."""
    return (np.linspace(1, 2, teams)[:, None, None] * rng.normal(size=(teams, n, 2))).astype(np.float32)


def course(teams: int, n: int, rng: np.random.Generator) -> np.ndarray:
    """Points [T, n, 2] (m) in the order of driving: laps of a closed curve of 5 km, evenly spaced but for noise.

    Each lap keeps an offset of its own from the curve and wanders smoothly about it.
    """
    angle = np.linspace(0, 2 * np.pi, 20_001)
    way = np.exp(1j * angle) * (1 + 0.3 * np.cos(2 * angle) + 0.1 * np.sin(5 * angle))
    along = np.concatenate([[0], np.cumsum(np.abs(np.diff(way)))])
    way, along = (line * LENGTH / along[-1] for line in (way, along))
    left = 1j * np.gradient(way) / np.abs(np.gradient(way))
    station = (np.arange(n) + rng.uniform(0, 0.5, (teams, n))) * LAPS * LENGTH / n
    lap, place = (station // LENGTH).astype(int), station % LENGTH
    offset = np.take_along_axis(APART * rng.normal(size=(teams, LAPS)), lap, axis=1)
    for waves in WAVES:
        phase = np.take_along_axis(rng.uniform(0, 2 * np.pi, (teams, LAPS)), lap, axis=1)
        offset = offset + SWAY * np.sin(2 * np.pi * waves * station / LENGTH + phase)
    points = np.interp(place, along, way) + offset * np.interp(place, along, left)
    return np.stack([points.real, points.imag], axis=-1).astype(np.float32)


KINDS = {"gaussian": gaussian, "course": course}
