"""What a log file must be told apart by: its layout, columns, units, names and how strictly it is read."""

import difflib
import math
from collections.abc import Iterable, Mapping
from typing import Any

from urbanjax.io.logs.record import LogError
from urbanjax.types import pytree, static
from urbanjax.types.arguments import kind

TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
LENGTH = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 1e-3, "km": 1000.0, "ft": 0.3048, "mi": 1609.344}
SPEED = {"m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704, "kn": 1852 / 3600, "ft/s": 0.3048, "cm/s": 0.01, "mm/s": 1e-3}
ANGLE = {"rad": 1.0, "deg": math.pi / 180}
UNITS: dict[str, dict[str, float]] = {"time": TIME, "position": LENGTH, "speed": SPEED, "heading": ANGLE}
ROLES = ("time", "x", "y", "speed", "heading")  # of columns that hold numbers
NAMES = ("vehicle", "team", "run")  # and of those that hold names
LAYOUTS = ("single", "long", "wide")


def _choice(default: str, choices: Iterable[str]) -> Any:
    return static(default=default, metadata={"choices": tuple(choices)})


@pytree
class Columns:
    """Names of columns; an empty one is not there. In JSON a dotted path (`tel.x`), in wide files with {i} (`E{i}`)."""

    time: str = static(default="time")
    x: str = static(default="x")
    y: str = static(default="y")
    speed: str = static(default="")
    heading: str = static(default="")
    vehicle: str = static(default="")  # whose values name the vehicle of a row (long layout)
    team: str = static(default="")  # likewise, of the vehicle's team
    run: str = static(default="")  # likewise, of the run


@pytree
class Units:
    """In which unit each column is; none is ever guessed."""

    time: str = _choice("s", TIME)
    position: str = _choice("m", LENGTH)
    speed: str = _choice("m/s", SPEED)
    heading: str = _choice("rad", ANGLE)
    compass: bool = static(default=False)  # heading counts clockwise from y (north)


@pytree
class LogFormat:
    """How a file of logs is laid out and how strictly it is read.

    Layouts: `single`, one vehicle per file; `long`, one row per vehicle and time; `wide`, one row per time and a set
    of columns per vehicle i = 1, 2, ... `path` is the end of the file's path without its suffix, where {team},
    {vehicle} and {run} stand for names: `{team}/{run}_tel`.
    """

    columns: Columns = Columns()
    units: Units = Units()
    layout: str = _choice("single", LAYOUTS)
    path: str = static(default="{run}")
    preamble: int = static(default=0, metadata={"range": (0, 1000)})  # lines before the header of a CSV
    vehicles: str = static(default="")  # first word of the preamble's line that names vehicle 1, 2, ... (wide layout)
    delimiter: str = static(default=",")
    records: str = static(default="")  # dotted path of the list of records, or of the columns, in JSON
    speed_factor: float = static(default=1.25, metadata={"range": (1.01, 1e3)})  # of stated speed to that of positions
    not_finite: str = _choice("error", ("error", "drop"))
    duplicates: str = _choice("error", ("error", "drop", "first"))  # drop: equal samples; first: also unequal ones
    time_order: str = _choice("error", ("error", "sort"))
    short: str = _choice("error", ("error", "drop"))  # vehicles with fewer than two samples


def check(form: LogFormat) -> None:
    """Raise LogError where the parts of a format do not go together.

    Args: form, a file's format.
    """
    kind(form.columns, "format: 'columns'", wanted=Columns, error=LogError)
    kind(form.units, "format: 'units'", wanted=Units, error=LogError)
    if len(form.delimiter) != 1 or form.delimiter in '"\r\n' or not form.delimiter.isascii():
        raise LogError(f"format: 'delimiter' must be one character, not {form.delimiter!r}")
    for name in ("time", "x", "y"):
        if not getattr(form.columns, name):
            raise LogError(f"format: 'columns.{name}' is empty; every log has time and position")
    taken: dict[str, str] = {}
    for role in (*ROLES, *NAMES):
        name = getattr(form.columns, role)
        other = taken.setdefault(name, role) if name else role
        if other != role and not {other, role} <= {*NAMES}:
            raise LogError(f"format: 'columns.{other}' and 'columns.{role}' are both {name!r}: each needs its own")
    told = [role for role in NAMES if getattr(form.columns, role)]
    if told and form.layout != "long":
        raise LogError(
            f"format: 'columns.{told[0]}' is read in the long layout only: set layout=long, or leave it out ('path' "
            "names the vehicle of a file)"
        )
    if form.layout == "long" and not form.columns.vehicle:
        raise LogError("format: 'columns.vehicle' is empty; in the long layout a column names the vehicle")
    if form.layout == "wide" and not all("{i}" in getattr(form.columns, name) for name in ("x", "y")):
        raise LogError("format: 'columns.x' and 'columns.y' must hold {i}, the vehicle's number, in the wide layout")


def scale(form: LogFormat, role: str) -> float:
    """What one unit of a column (time, position, speed, heading) is in s, m, m/s or rad.

    Args: form, the file's format; role of the column.
    """
    return UNITS[role][getattr(form.units, role)]


def fitting(form: LogFormat, ratio: float, *, within: float = 1.1) -> list[str]:
    """Settings `units.role=unit` that bring the ratio of stated speed to that of the positions within `within` of 1.

    Nearest first.
    Args: form, the file's format; ratio of stated speed to that of the positions; within, the factor.
    """
    found: list[tuple[float, str]] = []
    for role, sign in (("speed", 1), ("position", -1), ("time", 1)):
        for unit, value in UNITS[role].items():
            off = abs(math.log(ratio * (value / scale(form, role)) ** sign))
            if off < math.log(within):
                found.append((round(off, 6), f"units.{role}={unit}"))
    return [setting for _, setting in sorted(found, key=lambda pair: pair[0])]


def nearest(name: str, names: Iterable[str]) -> str:
    """A clause that names the columns nearest to a missing one.

    Args: name of the missing column; names of those that are there.
    """
    lower: Mapping[str, str] = {other.lower(): other for other in names}
    found = difflib.get_close_matches(name.lower(), lower, n=3, cutoff=0.5)
    if not found:
        shown = list(lower.values())
        return f"there are {', '.join(shown[:12])}{', ...' if len(shown) > 12 else ''}" if shown else "there are none"
    return f"the nearest are {', '.join(repr(lower[key]) for key in found)}"
