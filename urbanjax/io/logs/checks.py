"""Samples in SI units and in rising time, as far as a format allows what is wrong with them."""

from typing import Any, NamedTuple

import numpy as np

from urbanjax.io.logs.format import LogFormat, scale
from urbanjax.io.logs.record import LogError, LogReport

LIMITS = {"time": 1e12, "x": 1e9, "y": 1e9, "speed": 1e4, "heading": 1e6}  # s, m, m/s, rad: no log holds more
UNIT = {"time": "s", "x": "m", "y": "m", "speed": "m/s", "heading": "rad"}
NEEDED = ("time", "x", "y")


class Samples(NamedTuple):
    """The rows of one vehicle as a file has them, [R] each."""

    source: str
    word: str  # what a message calls a row
    columns: dict[str, str]  # role -> column
    values: dict[str, np.ndarray]  # role -> numbers, NaN where absent
    absent: dict[str, np.ndarray]  # role -> which cells are empty
    rows: np.ndarray

    def fail(self, k: int, role: str, message: str) -> LogError:
        """The error to raise about one cell."""
        return LogError(f"{self.source}: {self.word} {self.rows[k]}, column {self.columns[role]!r}: {message}")

    def take(self, which: np.ndarray) -> "Samples":
        """Some of the rows only."""
        values = {role: v[which] for role, v in self.values.items()}
        absent = {role: v[which] for role, v in self.absent.items()}
        return self._replace(values=values, absent=absent, rows=self.rows[which])


def cleaned(samples: Samples, form: LogFormat, *, vehicle: str) -> tuple[dict[str, np.ndarray] | None, LogReport]:
    """Columns in SI units by role, and `rows`, in rising time; with them what was left out.

    None in place of the columns where fewer than two samples remain and the format leaves such vehicles out.
    Args: samples of one vehicle, as the file has them; form, the file's format; vehicle, its name for messages. Raises
    LogError, naming row and column, for what the format does not allow.
    """
    count: dict[str, Any] = {"rows": len(samples.rows)}
    absent = np.any([samples.absent[role] for role in NEEDED], axis=0)
    count["absent"] = int(absent.sum())
    samples = _finite(samples.take(~absent), form, count)
    samples = _in_units(samples, form)
    samples = _ordered(samples, form, count)
    samples = _once(samples, form, count)
    if len(samples.rows) < 2:
        if form.short == "drop":
            return None, LogReport(**count)
        raise LogError(
            f"{samples.source}: columns {', '.join(map(repr, samples.columns.values()))}: vehicle {vehicle} has "
            f"{len(samples.rows)} samples, a log has two or more (short=drop leaves such vehicles out)"
        )
    return {**samples.values, "rows": samples.rows}, LogReport(**count)


def _finite(samples: Samples, form: LogFormat, count: dict[str, Any]) -> Samples:
    """Samples whose time and position are finite; other values that are not become absent."""
    bad = {role: ~np.isfinite(v) & ~samples.absent[role] for role, v in samples.values.items()}
    if form.not_finite == "error":
        for role, wrong in bad.items():
            if wrong.any():
                k = int(np.argmax(wrong))
                value = samples.values[role][k]
                raise samples.fail(k, role, f"{value} is not finite; correct it (not_finite=drop leaves it out)")
    values = {role: np.where(bad[role], np.nan, v) for role, v in samples.values.items()}
    unusable = np.any([bad[role] for role in NEEDED], axis=0)
    count["not_finite"] = int(unusable.sum())
    return samples._replace(values=values).take(~unusable)


def _in_units(samples: Samples, form: LogFormat) -> Samples:
    """Samples in s, m, m/s and rad, within what a log can hold."""
    values = {}
    for role, value in samples.values.items():
        with np.errstate(over="ignore"):
            values[role] = value * scale(form, "position" if role in ("x", "y") else role)
        wrong = np.abs(values[role]) > LIMITS[role]
        if wrong.any():
            k = int(np.argmax(wrong))
            raise samples.fail(
                k, role, f"{value[k]:g} is beyond {LIMITS[role]:g} {UNIT[role]}; correct it, or the unit"
            )
    if form.units.compass and "heading" in values:
        values["heading"] = np.pi / 2 - values["heading"]
    return samples._replace(values=values)


def _ordered(samples: Samples, form: LogFormat, count: dict[str, Any]) -> Samples:
    """Samples whose time does not fall."""
    time = samples.values["time"]
    early = np.diff(time) < 0
    if not early.any():
        return samples
    if form.time_order == "error":
        k = int(np.argmax(early)) + 1
        raise samples.fail(
            k,
            "time",
            f"{time[k]:.12g} s is earlier than {time[k - 1]:.12g} s before; correct it (time_order=sort sorts)",
        )
    count["unordered"] = int(early.sum())
    return samples.take(np.argsort(time, kind="stable"))


def _once(samples: Samples, form: LogFormat, count: dict[str, Any]) -> Samples:
    """Samples whose time rises: of several at one time the first."""
    time, x, y = (samples.values[role] for role in NEEDED)
    again = np.concatenate([[False], np.diff(time) <= 0]) if len(time) else np.zeros(0, bool)
    if not again.any():
        return samples
    first = np.maximum.accumulate(np.where(again, 0, np.arange(len(time))))
    other = again & ((x != x[first]) | (y != y[first]))
    for wrong, allowed, what in (
        (other, ("first",), "is said twice, at different positions; correct it (duplicates=first keeps the first)"),
        (again, ("first", "drop"), "is said twice; leave it out (duplicates=drop does so)"),
    ):
        if wrong.any() and form.duplicates not in allowed:
            k = int(np.argmax(wrong))
            raise samples.fail(k, "time", f"{time[k]:.12g} s {what}, see {samples.word} {samples.rows[first[k]]}")
    count["duplicates"] = int(again.sum())
    return samples.take(~again)
