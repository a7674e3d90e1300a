"""The log of one vehicle on one run, and what was met on the way into it."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from urbanjax.types import FileError, host_record
from urbanjax.types.arguments import array

GIVEN = ("time", "position")  # what a log cannot be without


class LogError(FileError):
    """A vehicle log is malformed, or holds what no log can hold."""


@host_record
class LogReport:
    """What reading a log left out, put in order or noticed."""

    rows: int = 0  # of the file that speak of this vehicle
    absent: int = 0  # without time or position
    not_finite: int = 0  # left out as not finite
    duplicates: int = 0  # left out as said before
    unordered: int = 0  # earlier than the sample before, and sorted
    speed_ratio: float = float("nan")  # stated speed over that of the positions; NaN where nothing can be compared
    notes: tuple[str, ...] = ()

    @property
    def dropped(self) -> int:
        """Rows that are no sample of the log."""
        return self.absent + self.not_finite + self.duplicates


@host_record
class VehicleLog:
    """n samples of one vehicle, in rising time. Speed and heading are None, or NaN where the file has no value."""

    vehicle: str
    time: np.ndarray  # [n] s
    position: np.ndarray  # [n, 2] m
    speed: np.ndarray | None = None  # [n] m/s
    heading: np.ndarray | None = None  # [n] rad, counter-clockwise from x
    team: str = ""  # that the vehicle belongs to, by default a team of its own
    run: str = ""  # or lap
    source: str = ""  # the file
    rows: np.ndarray | None = None  # [n] where each sample stands in the file (lines from 1), by default its index
    report: LogReport = LogReport()

    def __post_init__(self) -> None:
        if not self.team:
            object.__setattr__(self, "team", self.vehicle)
        if self.rows is None:
            object.__setattr__(self, "rows", np.arange(len(self.time)))

    @property
    def name(self) -> str:
        """How messages and figures name the log."""
        return " ".join(dict.fromkeys(part for part in (self.team, self.vehicle, self.run) if part))

    @property
    def n(self) -> int:
        """Number of samples."""
        return len(self.time)

    def take(self, which: np.ndarray) -> "VehicleLog":
        """The log with some of its samples only (mask [n] or indices)."""
        arrays = ("time", "position", "speed", "heading", "rows")
        parts = {name: getattr(self, name) for name in arrays}
        return dataclasses.replace(self, **{k: None if v is None else v[which] for k, v in parts.items()})


def from_arrays(vehicle: str, time: np.ndarray, *, position: np.ndarray, **others: Any) -> VehicleLog:
    """A log of arrays at hand, say of a simulation: time [n] s rising, position [n, 2] m, other fields by name.

    Args: vehicle, its name; time [n] s; position [n, 2] m; others, any other field of a log. Raises LogError for shapes
    that do not fit, values that are not finite and time that does not rise.
    """
    time, position = (
        array(x, f"log {vehicle}: {name}", error=LogError) for name, x in zip(GIVEN, (time, position), strict=True)
    )
    fields = [spec.name for spec in dataclasses.fields(VehicleLog) if spec.name not in ("vehicle", *GIVEN)]
    unknown = others.keys() - set(fields)
    if unknown:
        raise LogError(f"log {vehicle}: has no field {min(unknown)!r}: use of {', '.join(fields)}")
    if time.ndim != 1 or position.shape != (len(time), 2) or len(time) < 2:
        raise LogError(f"log {vehicle}: time {time.shape} and position {position.shape} are not [n] and [n, 2], n > 1")
    for key in ("speed", "heading"):
        if others.get(key) is not None:
            others[key] = array(others[key], f"log {vehicle}: {key}", error=LogError)
            if others[key].shape != time.shape:
                raise LogError(f"log {vehicle}: {key} {others[key].shape} has not the shape of time {time.shape}")
    wrong = ~(np.isfinite(time) & np.isfinite(position).all(1))
    wrong[1:] |= ~(np.diff(time) > 0)
    if wrong.any():
        k = int(np.argmax(wrong))
        raise LogError(f"log {vehicle}: sample {k} at {time[k]} s: is not finite, or no later than the one before")
    return VehicleLog(vehicle, time, position, **others)


def path_text(path: str | Path) -> str:
    """A path as messages and records show it.

    Args: path of any file.
    """
    return Path(path).as_posix()
