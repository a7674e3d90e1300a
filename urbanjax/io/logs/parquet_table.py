"""Parquet files as tables."""

import functools
import io
from pathlib import Path
from typing import Any

import numpy as np

from urbanjax.io.logs.format import LogFormat
from urbanjax.io.logs.record import LogError, path_text
from urbanjax.io.logs.table import LogTable, short

MOST_CELLS = 100_000_000  # of the columns that are read


def load(path: Path, data: bytes, *, form: LogFormat) -> LogTable:
    """The table of a Parquet file with flat columns.

    Args: path, for messages; data, the bytes of the file; form, the file's format.
    """
    import pyarrow
    import pyarrow.parquet

    try:
        file = pyarrow.parquet.ParquetFile(io.BytesIO(data))
        names, rows = tuple(file.schema_arrow.names), file.metadata.num_rows
    except (pyarrow.ArrowException, OSError, ValueError, KeyError) as error:
        raise LogError(f"{path_text(path)}: is no Parquet file, or cut off ({short(error)})") from error

    @functools.lru_cache(maxsize=1)  # the vehicles of a long file share their columns
    def read(wanted: tuple[str, ...]) -> tuple[dict[str, Any], np.ndarray]:
        if not 0 <= rows * len(wanted) <= MOST_CELLS:
            raise LogError(f"{path_text(path)}: {rows} rows are too many; split the file")
        try:
            table = file.read(columns=list(wanted))
            table.validate(full=True)
            columns = {name: _plain(table[name].combine_chunks()) for name in wanted}
        except (pyarrow.ArrowException, OSError, ValueError, KeyError) as error:
            raise LogError(f"{path_text(path)}: is a damaged Parquet file ({short(error)})") from error
        return columns, np.arange(table.num_rows)

    return LogTable(path, names, (), "row", read)


def _plain(array: Any) -> Any:
    import pyarrow

    return array.dictionary_decode() if pyarrow.types.is_dictionary(array.type) else array
