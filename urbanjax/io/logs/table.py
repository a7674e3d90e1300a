"""A log file as a table whose columns are found by name."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from urbanjax.io.logs.format import nearest
from urbanjax.io.logs.record import LogError, path_text


class LogTable(NamedTuple):
    """A file whose cells are read column by column."""

    path: Path
    names: tuple[str, ...]  # of the columns
    vehicles: tuple[str, ...]  # as the preamble names them; empty where it does not
    word: str  # what a message calls a row
    read: Callable[[tuple[str, ...]], tuple[dict[str, Any], np.ndarray]]  # columns -> cells of each [R], rows [R]

    def cells(self, wanted: Sequence[str]) -> tuple[dict[str, Any], np.ndarray]:
        """Cells [R] of each wanted column, and where each row stands in the file [R].

        Raises LogError for a column that is missing or there twice, with the nearest names, and for uneven columns.
        """
        for name in wanted:
            if self.names.count(name) != 1:
                wrong = "is there more than once" if name in self.names else f"is missing; {nearest(name, self.names)}"
                raise LogError(f"{path_text(self.path)}: column {name!r} {wrong}")
        return self.read(tuple(dict.fromkeys(wanted)))


def text_of(path: Path, data: bytes) -> str:
    """The text of a file.

    Args: path, for messages; data, the bytes of the file. Raises LogError, naming the line, where it is not UTF-8.
    """
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise LogError(f"{path_text(path)}: is UTF-16; save it as UTF-8")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise LogError(f"{path_text(path)}: line {line}: is not UTF-8; save the file as UTF-8") from error
    if "\0" in text:
        line = text[: text.index("\0")].count("\n") + 1
        raise LogError(f"{path_text(path)}: line {line}: holds a zero byte: it is damaged, or no UTF-8 text")
    return text


def short(error: BaseException) -> str:
    """The message of an error of a library in at most 120 characters.

    Args: error, as caught.
    """
    return " ".join(str(error).split())[:120] or type(error).__name__
