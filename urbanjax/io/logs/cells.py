"""Cells of a file as numbers and as names; what is neither is an error that says where it stands."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from urbanjax.io.logs.record import LogError

ABSENT = ("", "none", "null", "na", "n/a", "-")  # lower case; `nan` is a number that is not finite
LONGEST = 400  # characters of a number: Python refuses to read much longer ones


def numbers(cells: Any, where: Callable[[int], str]) -> tuple[np.ndarray, np.ndarray]:
    """Values [R] (NaN where absent) and which are absent [R], of a pyarrow array or a sequence of Python values.

    Args: cells, a pyarrow array or a sequence [R]; where, what names cell k in a message. Raises LogError for a cell
    that is neither empty nor a number.
    """
    if not isinstance(cells, Sequence):
        quick = _quick(cells)
        if quick is not None:
            return quick
        cells = cells.to_pylist()
    values = np.full(len(cells), np.nan)
    absent = np.zeros(len(cells), bool)
    for k, cell in enumerate(cells):
        if cell is None or (isinstance(cell, str) and cell.strip().lower() in ABSENT):
            absent[k] = True
            continue
        value = _number(cell)
        if value is None:
            raise LogError(f"{where(k)}: {str(cell)[:40]!r} is no number; correct it, or leave the cell empty")
        values[k] = value
    return values, absent


def _quick(cells: Any) -> tuple[np.ndarray, np.ndarray] | None:
    """As `numbers`, all at once; None where not all cells are numbers."""
    import pyarrow
    import pyarrow.compute as compute

    if pyarrow.types.is_string(cells.type):
        cells = compute.call_function("utf8_trim_whitespace", [cells])
        lower = compute.call_function("utf8_lower", [cells])
        given = compute.invert(compute.is_in(lower, value_set=pyarrow.array(ABSENT)))
        cells = compute.if_else(given, cells, pyarrow.scalar(None, cells.type))
    elif not (pyarrow.types.is_integer(cells.type) or pyarrow.types.is_floating(cells.type)):
        return None
    try:
        values = compute.cast(cells, pyarrow.float64(), safe=False)
    except pyarrow.ArrowException:
        return None
    absent = np.asarray(values.is_null().to_numpy(zero_copy_only=False))
    return np.array(values.to_numpy(zero_copy_only=False), float), absent


def _number(cell: Any) -> float | None:
    if isinstance(cell, str):
        if "_" in cell or not cell.isascii() or len(cell) > LONGEST:
            return None
    elif isinstance(cell, bool):
        return None
    try:
        return float(cell)
    except OverflowError:
        return math.inf
    except (TypeError, ValueError):
        return None


def names(cells: Any, where: Callable[[int], str]) -> list[str]:
    """The names in a column, stripped; numbers count as names.

    Args: cells, a pyarrow array or a sequence [R]; where, what names cell k in a message. Raises LogError for an empty
    cell.
    """
    cells = cells if isinstance(cells, Sequence) else cells.to_pylist()
    found = []
    for k, cell in enumerate(cells):
        usable = isinstance(cell, str | int | float) and not (isinstance(cell, float) and math.isnan(cell))
        name = str(cell).strip() if usable else ""
        if not name:
            raise LogError(f"{where(k)}: {str(cell)[:40]!r} is no name; every row of this layout names its vehicle")
        found.append(name)
    return found
