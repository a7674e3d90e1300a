"""Logs of vehicles from CSV, JSON and Parquet files: one record per vehicle and run."""

import glob
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from urbanjax.io.files import content, path_of
from urbanjax.io.logs import cells as cell
from urbanjax.io.logs import csv_table, json_table, parquet_table
from urbanjax.io.logs.agreement import compared
from urbanjax.io.logs.checks import Samples, cleaned
from urbanjax.io.logs.format import NAMES, ROLES, LogFormat, check
from urbanjax.io.logs.record import LogError, VehicleLog, path_text
from urbanjax.io.logs.table import LogTable
from urbanjax.types import FileError
from urbanjax.types.arguments import kind

LARGEST = 256 * 2**20  # bytes of a file
LOADERS: dict[str, Callable[..., LogTable]] = {  # of path, data and form
    ".csv": csv_table.load,
    ".txt": csv_table.load,
    ".json": json_table.load,
    ".parquet": parquet_table.load,
}


class Part(NamedTuple):
    """The rows and columns of one vehicle in a table."""

    names: dict[str, str]  # vehicle, team, run, as far as known
    columns: dict[str, str]  # role -> column
    which: np.ndarray | None  # [n] indices of rows, None for all


def read(paths: str | Path | Iterable[str | Path], form: LogFormat | None = None) -> list[VehicleLog]:
    """The logs of one or more files, each a path or a pattern (`*/*_tel.json`), in the order of files and vehicles.

    Args: paths of files, or patterns; form, the files' format (default: columns time, x and y in s and m, one vehicle
    per file). Raises LogError, naming file, row and column and what to do, for a file that is missing, too large, cut
    off or not in the stated format; for samples that are not finite, said twice or out of order, unless the format says
    what to do with them; and for units in which the stated speed is not that of the positions.
    """
    form = LogFormat() if form is None else form
    kind(form, "form", wanted=LogFormat, error=LogError)
    check(form)
    several = list(paths) if isinstance(paths, Iterable) and not isinstance(paths, str | bytes) else [paths]
    logs: list[VehicleLog] = []
    for path in files([path_of(path) for path in several]):
        logs += read_file(path, form)
    return logs


def files(paths: str | Path | Iterable[str | Path]) -> list[Path]:
    """The files that paths and patterns name, each once.

    Args: paths of files, or patterns. Raises LogError for one that names none.
    """
    found: list[Path] = []
    for path in [paths] if isinstance(paths, str | Path) else paths:
        text = str(path)
        if Path(text).is_dir():
            raise LogError(f"{path_text(path)}: is a folder; name its files, say {path_text(Path(path, '*.csv'))}")
        matches = [text] if not glob.has_magic(text) or Path(text).exists() else glob.glob(text, recursive=True)
        if not matches:
            raise LogError(f"{path_text(path)}: no file has such a name")
        found += [Path(match) for match in sorted(matches)]
    if not found:
        raise LogError("no log files are named")
    return list(dict.fromkeys(found))


def read_file(path: Path, form: LogFormat) -> list[VehicleLog]:
    """The logs of one file; errors as of `read`.

    Args: path of the file; form, its format.
    """
    table = load(path, form)
    stated = named(path, form)
    logs = []
    for part in LAYOUTS[form.layout](table, form):
        log = _log(table, form, part, stated)
        if log is not None:
            logs.append(log)
    if not logs:
        raise LogError(f"{path_text(path)}: no vehicle has two samples or more")
    return logs


def load(path: Path, form: LogFormat) -> LogTable:
    """The table of a file, by its suffix.

    Args: path of the file; form, its format. Raises LogError for a file that is missing, too large or no such file.
    """
    loader = LOADERS.get(path.suffix.lower())
    if loader is None:
        raise LogError(f"{path_text(path)}: a log ends in {', '.join(LOADERS)}, not in {path.suffix!r}")
    try:
        size = path.stat().st_size if path.is_file() else 0
        if size > LARGEST:
            raise LogError(f"{path_text(path)}: {size} bytes are more than the {LARGEST} that it may have; split it")
        data = content(path)
    except (OSError, ValueError) as error:
        raise LogError(f"{path_text(path)}: cannot be read ({error})") from error
    except LogError:
        raise
    except FileError as error:
        raise LogError(str(error)) from error
    if not data.strip():
        raise LogError(f"{path_text(path)}: is empty")
    return loader(path, data, form=form)


def named(path: Path, form: LogFormat) -> dict[str, str]:
    """Names of team, vehicle and run as the file's path states them.

    Args: path of the file; form, its format. Raises LogError where it is made otherwise.
    """
    pieces = re.split(r"\{(team|vehicle|run)\}", form.path)
    if len(set(pieces[1::2])) < len(pieces[1::2]):
        raise LogError(f"format: 'path' {form.path!r} holds one name twice")
    pattern = "".join(f"(?P<{p}>[^/]+)" if k % 2 else re.escape(p) for k, p in enumerate(pieces))
    text = path_text(path.absolute().with_suffix(""))
    match = re.search(f"(?:^|/){pattern}$", text)
    if match is None:
        raise LogError(f"{path_text(path)}: the path does not end as the format says, {form.path!r} (path)")
    return match.groupdict()


def _single(table: LogTable, form: LogFormat) -> Iterator[Part]:
    yield Part({}, {role: name for role in ROLES if (name := getattr(form.columns, role))}, None)


def _long(table: LogTable, form: LogFormat) -> Iterator[Part]:
    """One part per vehicle, team and run, in the order in which they first appear."""
    columns = {role: name for role in ROLES if (name := getattr(form.columns, role))}
    keys = {role: name for role in NAMES if (name := getattr(form.columns, role))}
    found, rows = table.cells([*columns.values(), *keys.values()])
    told = [cell.names(found[name], _where(table, rows, name)) for name in keys.values()]
    groups: dict[tuple[str, ...], list[int]] = {}
    for k, key in enumerate(zip(*told, strict=True)):
        groups.setdefault(key, []).append(k)
    for key, which in groups.items():
        yield Part(dict(zip(keys, key, strict=True)), columns, np.array(which))


def _wide(table: LogTable, form: LogFormat) -> Iterator[Part]:
    """One part per number i that the header has columns for; the preamble names the vehicles, or the number does."""
    before, after = form.columns.x.split("{i}", 1)
    numbered = [re.fullmatch(f"{re.escape(before)}([0-9]{{1,6}}){re.escape(after)}", name) for name in table.names]
    numbers = sorted({int(match[1]) for match in numbered if match})
    if not numbers:
        table.cells([form.columns.x.replace("{i}", "1")])  # says which columns there are
    for i in numbers:
        if table.vehicles and not 1 <= i <= len(table.vehicles):
            raise LogError(
                f"{path_text(table.path)}: column {form.columns.x.replace('{i}', str(i))!r}: vehicle {i} has no name; "
                f"{form.vehicles!r} names {len(table.vehicles)}"
            )
        columns = {role: name.replace("{i}", str(i)) for role in ROLES if (name := getattr(form.columns, role))}
        name = table.vehicles[i - 1] if table.vehicles else str(i)
        yield Part({"vehicle": name}, columns, None)


LAYOUTS = {"single": _single, "long": _long, "wide": _wide}


def _where(table: LogTable, rows: np.ndarray, column: str) -> Callable[[int], str]:
    return lambda k: f"{path_text(table.path)}: {table.word} {rows[k]}, column {column!r}"


def _log(table: LogTable, form: LogFormat, part: Part, stated: dict[str, str]) -> VehicleLog | None:
    """The log of one part of a table; None where it has fewer than two samples and may be left out."""
    found, rows = table.cells(list(part.columns.values()))
    rows = rows if part.which is None else rows[part.which]
    values: dict[str, Any] = {}
    absent: dict[str, np.ndarray] = {}
    for role, name in part.columns.items():
        values[role], absent[role] = cell.numbers(_some(found[name], part.which), _where(table, rows, name))
    names = {**stated, **part.names}
    vehicle = names.get("vehicle") or names.get("team") or table.path.stem
    samples = Samples(path_text(table.path), table.word, part.columns, values, absent, rows)
    clean, report = cleaned(samples, form, vehicle=vehicle)
    if clean is None:
        return None
    position = np.stack([clean["x"], clean["y"]], -1)
    log = VehicleLog(
        vehicle=vehicle,
        time=clean["time"],
        position=position,
        speed=clean.get("speed"),
        heading=clean.get("heading"),
        team=names.get("team", ""),
        run=names.get("run", "") if "run" in names else table.path.stem,
        source=path_text(table.path),
        rows=clean["rows"].astype(int),
        report=report,
    )
    return compared(log, form, column=part.columns.get("speed", ""))


def _some(found: Any, which: np.ndarray | None) -> Any:
    if which is None:
        return found
    return [found[k] for k in which] if isinstance(found, list) else found.take(which)
