"""Files on their way in: where real data is, and what is asked of every file before it is read."""

import os
from pathlib import Path
from typing import Any

from urbanjax.types import FileError
from urbanjax.types.arguments import short

LONGEST_NAME, LONGEST_PATH = 255, 4000  # bytes of a name, and of a path with its folders
LARGEST = 512 * 2**20  # bytes


def path_of(path: Any) -> Path:
    """The path. Raises FileError for what is none, whatever stands there. Args: path, as given."""
    if not isinstance(path, str | os.PathLike) or isinstance(os.fspath(path), bytes):
        raise FileError(f"{short(path)} is no path of a file: give a text or a Path")
    text = os.fspath(path)
    if not text or "\0" in text:
        raise FileError(f"{short(text)} is no name of a file: it {'holds a zero byte' if text else 'is empty'}")
    if max(map(_size, Path(text).parts), default=0) > LONGEST_NAME or _size(text) > LONGEST_PATH:
        raise FileError(
            f"{short(text)} is no name of a file: it has {len(text)} characters, more than any name may have"
        )
    return Path(text)


def file_of(path: Any) -> Path:
    """The path of a file to read. Raises FileError for what is none, and for a folder. Args: path, as given."""
    found = path_of(path)
    if found.is_dir():
        raise FileError(f"{found}: is a folder: name a file in it")
    return found


def _size(text: str) -> int:
    return len(os.fsencode(text))


def content(path: Path) -> bytes:
    """The bytes of a file.

    Args: path of the file. Raises FileError if it is missing, unreadable or has more than LARGEST bytes.
    """
    try:
        size = path.stat().st_size
        if size > LARGEST:
            raise FileError(f"{path}: {size} bytes are more than the {LARGEST} that it may have")
        return path.read_bytes()
    except FileNotFoundError as error:
        raise FileError(f"{path}: there is no such file") from error
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror})") from error


def data_folder() -> Path:
    """Where real data is: $URBANJAX_DATA, or shared/data beside the project."""
    return Path(os.environ.get("URBANJAX_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
