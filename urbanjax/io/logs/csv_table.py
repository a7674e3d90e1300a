"""CSV files as tables: a preamble, a header and rows."""

import functools
import io
from pathlib import Path
from typing import Any

import numpy as np

from urbanjax.io.logs.format import LogFormat
from urbanjax.io.logs.record import LogError, path_text
from urbanjax.io.logs.table import LogTable, short, text_of


def load(path: Path, data: bytes, *, form: LogFormat) -> LogTable:
    """The table of a CSV: a preamble, a header and rows of as many cells.

    Args: path, for messages; data, the bytes of the file; form, the file's format.
    """
    text = text_of(path, data)
    *head, rest = text.split("\n", form.preamble + 1)
    if len(head) <= form.preamble:
        head.append(rest)
        rest = ""
    if len(head) <= form.preamble:
        raise LogError(f"{path_text(path)}: has {len(head)} lines; the header is expected in line {form.preamble + 1}")
    split = [_split(line, form.delimiter) for line in head]
    names = split[-1]
    names[0] = names[0].lstrip("#").strip()
    stated = next((cells[1:] for cells in split[:-1] if form.vehicles and cells[0] == form.vehicles), None)
    if form.vehicles and stated is None:
        raise LogError(
            f"{path_text(path)}: none of the first {form.preamble} lines begins with {form.vehicles!r}, which names "
            "the vehicles (preamble, vehicles)"
        )
    while stated and not stated[-1]:
        stated.pop()

    @functools.lru_cache(maxsize=1)  # the vehicles of a long file share their columns
    def read(wanted: tuple[str, ...]) -> tuple[dict[str, Any], np.ndarray]:
        return _cells(path, rest.rstrip("\r\n"), names, wanted, form)

    return LogTable(path, tuple(names), tuple(stated or ()), "line", read)


def _split(line: str, delimiter: str) -> list[str]:
    return [cell.strip().strip('"').strip() for cell in line.rstrip("\r").split(delimiter)]


def _cells(
    path: Path, text: str, names: list[str], wanted: tuple[str, ...], form: LogFormat
) -> tuple[dict[str, Any], np.ndarray]:
    import pyarrow
    import pyarrow.csv

    first = form.preamble + 2
    faults: list[Any] = []
    inner = {name: f"c{names.index(name)}" for name in wanted}
    if not text:
        raise LogError(f"{path_text(path)}: line {first}: there are no rows below the header")
    data = text.encode()
    try:
        table = pyarrow.csv.read_csv(
            io.BytesIO(data),
            pyarrow.csv.ReadOptions(
                use_threads=False,
                block_size=max(len(data) + 1, 2**16),
                column_names=[f"c{k}" for k in range(len(names))],
            ),
            pyarrow.csv.ParseOptions(
                delimiter=form.delimiter,
                ignore_empty_lines=False,
                invalid_row_handler=lambda row: faults.append(row) or "skip",
            ),
            pyarrow.csv.ConvertOptions(
                include_columns=list(inner.values()), column_types=dict.fromkeys(inner.values(), pyarrow.string())
            ),
        )
    except pyarrow.ArrowException as error:
        raise LogError(f"{path_text(path)}: is no CSV ({short(error)})") from error
    if faults:
        row = faults[0]
        raise LogError(
            f"{path_text(path)}: line {first - 1 + (row.number or 1)}: has {row.actual_columns} cells, the header "
            f"{len(names)}; the file is cut off, or its delimiter is not {form.delimiter!r}"
        )
    return {name: table[key].combine_chunks() for name, key in inner.items()}, np.arange(table.num_rows) + first
