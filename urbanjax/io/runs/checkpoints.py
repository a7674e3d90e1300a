"""Named arrays and texts in one safetensors file: what a search keeps to go on after a kill, and networks."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from urbanjax.io import files
from urbanjax.types import FileError
from urbanjax.types.errors import TuningError


def write_checkpoint(path: Path, arrays: Mapping[str, np.ndarray], *, about: Mapping[str, str]) -> None:
    """Write them, whole or not at all: whoever is killed meanwhile leaves the file of before.

    Args: path of the file; arrays by name; about, texts by name that say what they are of. Raises FileError where it
    cannot be written.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        data = _library().save({name: np.array(x, order="C") for name, x in arrays.items()}, metadata=dict(about))
        with open(part, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
    except OSError as error:
        raise FileError(f"{path}: cannot be written ({error.strerror})") from error
    finally:
        part.unlink(missing_ok=True)


def read_checkpoint(path: Path) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """The arrays and texts of a checkpoint. Args: path of the file. Raises FileError, naming it, where it is none."""
    library = _library()
    try:
        data = files.content(files.file_of(path))
        return library.load(data), _texts(data)
    except FileError:
        raise
    except Exception as error:  # of the library, which has one for every way in which a file can be cut off
        raise FileError(f"{path}: is no checkpoint, or part of one ({' '.join(str(error).split())})") from error


def _texts(data: bytes) -> dict[str, str]:
    """The texts in the header, which the library reads and does not give."""
    import json

    size = int.from_bytes(data[:8], "little")
    return json.loads(data[8 : 8 + size]).get("__metadata__", {})


def _library() -> Any:
    try:
        import safetensors.numpy
    except ImportError as error:
        raise TuningError('safetensors is not installed: pip install "urbanjax[tuning]"') from error
    return safetensors.numpy
