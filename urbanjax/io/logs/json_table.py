"""JSON files as tables: lists of one length, or a list of records."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from urbanjax.io.logs.format import LogFormat, nearest
from urbanjax.io.logs.record import LogError, path_text
from urbanjax.io.logs.table import LogTable, short, text_of

DEEPEST = 16  # groups within each other


def load(path: Path, data: bytes, *, form: LogFormat) -> LogTable:
    """The table of a JSON file: columns (lists of one length) or a list of records, below the key `records`.

    Args: path, for messages; data, the bytes of the file; form, the file's format.
    """
    text = text_of(path, data)
    try:
        tree = json.loads(text)
    except json.JSONDecodeError as error:
        cut = "; the file is cut off" if error.pos >= len(text.rstrip()) else ""
        raise LogError(f"{path_text(path)}: line {error.lineno}: is no JSON ({error.msg}){cut}") from error
    except (ValueError, RecursionError) as error:
        raise LogError(f"{path_text(path)}: is no JSON that can be read ({short(error)})") from error
    for key in filter(None, form.records.split(".")):
        if not isinstance(tree, dict) or key not in tree:
            names = tree if isinstance(tree, dict) else ()
            raise LogError(f"{path_text(path)}: key {form.records!r} (records) is missing; {nearest(key, names)}")
        tree = tree[key]
    if isinstance(tree, dict):
        columns = dict(_columns(tree))
        return LogTable(path, tuple(columns), (), "element", lambda wanted: _even(path, columns, wanted))
    if not isinstance(tree, list) or not tree or not all(isinstance(record, dict) for record in tree):
        raise LogError(
            f"{path_text(path)}: holds neither columns nor a list of records; name the key that does (records)"
        )
    records = [_flat(record) for record in tree]
    known = tuple(dict.fromkeys(name for record in records for name in record))
    return LogTable(
        path,
        known,
        (),
        "record",
        lambda wanted: ({name: [r.get(name) for r in records] for name in wanted}, np.arange(len(records))),
    )


def _columns(tree: dict[str, Any], prefix: str = "", depth: int = 0) -> list[tuple[str, list[Any]]]:
    found: list[tuple[str, list[Any]]] = []
    for key, value in tree.items():
        if isinstance(value, list):
            found.append((f"{prefix}{key}", value))
        elif isinstance(value, dict) and depth < DEEPEST:
            found += _columns(value, f"{prefix}{key}.", depth + 1)
    return found


def _flat(record: dict[str, Any], prefix: str = "", depth: int = 0) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in record.items():
        if isinstance(value, dict) and depth < DEEPEST:
            found |= _flat(value, f"{prefix}{key}.", depth + 1)
        else:
            found[f"{prefix}{key}"] = value
    return found


def _even(path: Path, columns: dict[str, list[Any]], wanted: tuple[str, ...]) -> tuple[dict[str, Any], np.ndarray]:
    lengths = {name: len(columns[name]) for name in wanted}
    if len(set(lengths.values())) > 1:
        stated = ", ".join(f"{name!r} {length}" for name, length in lengths.items())
        raise LogError(f"{path_text(path)}: columns are of different lengths: {stated}")
    return {name: columns[name] for name in wanted}, np.arange(next(iter(lengths.values())))
