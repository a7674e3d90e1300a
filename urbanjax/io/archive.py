"""Records on disk: one npz file of plain arrays with a JSON header; nothing in it is ever executed."""

import json
import math
import os
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from urbanjax.types import FileError

MAX_BYTES = 1 << 30  # of all arrays together
MAX_HEADER = 1 << 22  # bytes of JSON


def save(path: str | os.PathLike[str], header: Mapping[str, Any], *, arrays: Mapping[str, np.ndarray]) -> None:
    """Writes header and arrays, whole or not at all.

    Args: path of the file; header, plain values, with `format` and `version`; arrays by name. Raises FileError where
    the file cannot be written.
    """
    path = Path(path)
    text = np.frombuffer(json.dumps(dict(header)).encode(), np.uint8)
    part = path.with_name(path.name + ".part")
    try:
        with part.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, header=text, **arrays)
        part.replace(path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise FileError(f"{path}: cannot be written ({error.strerror})") from error


def load(
    path: str | os.PathLike[str], format: str, *, version: int, names: Iterable[str]
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and the named arrays; sizes are checked before memory is taken.

    Args: path of the file; format, version: what the header has to say; names of the arrays that have to be there.
    Raises FileError with the file's name and the key that is wrong.
    """
    path, names = Path(path), tuple(names)
    try:
        with zipfile.ZipFile(path) as archive:
            header = _header(path, archive, format, version, names)
            return header, {name: _read(path, archive, name) for name in names}
    except FileNotFoundError as error:
        raise FileError(f"{path}: no such file") from error
    except (OSError, RuntimeError, zipfile.BadZipFile, EOFError, zlib.error) as error:
        raise FileError(f"{path}: is not a readable npz file ({error})") from error


def expect(path: str | os.PathLike[str], name: str, *, array: np.ndarray, kind: str, shape: tuple[int, ...]) -> None:
    """Raises FileError if the array is not of the kind (f, i, b) and shape, or holds numbers that are not finite.

    Args: path and name, which messages show; array, as read; kind, one of f, i, b; shape, its axes.
    """
    if array.dtype.kind != kind or array.shape != shape:
        raise FileError(f"{path}: {name!r} is {array.dtype} {array.shape}, expected kind {kind!r} and shape {shape}")
    if kind == "f" and not np.all(np.isfinite(array)):
        raise FileError(f"{path}: {name!r} has non-finite numbers")


def is_finite(x: Any) -> bool:
    """Whether a value of the header is a finite number.

    Args: x, a value as JSON gives it.
    """
    return isinstance(x, int | float) and not isinstance(x, bool) and math.isfinite(x)


def _header(path: Path, archive: zipfile.ZipFile, format: str, version: int, names: tuple[str, ...]) -> dict[str, Any]:
    """The JSON header, after a look at the sizes of everything."""
    stored = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
    missing = [name for name in ("header", *names) if name not in stored]
    if missing:
        raise FileError(
            f"{path}: key {missing[0]!r} is missing: not a {format.removeprefix('urbanjax ')}, or part of one"
        )
    if sum(info.file_size for info in stored.values()) > MAX_BYTES or stored["header"].file_size > MAX_HEADER:
        raise FileError(f"{path}: its arrays have more than {MAX_BYTES >> 20} MiB")
    text = _read(path, archive, "header")
    try:
        header = json.loads(text.astype(np.uint8).tobytes())
    except (ValueError, RecursionError) as error:
        raise FileError(f"{path}: 'header' is not JSON") from error
    if not isinstance(header, dict) or header.get("format") != format or header.get("version") != version:
        raise FileError(f"{path}: 'header' does not say {format!r}, version {version}")
    return header


def _read(path: Path, archive: zipfile.ZipFile, name: str) -> np.ndarray:
    """One array, whose announced size is checked against the file before memory is taken for it."""
    info = archive.getinfo(name + ".npy")
    try:
        with archive.open(info) as file:
            version = np.lib.format.read_magic(file)
            reader = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}[version]
            shape, _, dtype = reader(file)
            if dtype.hasobject or math.prod(shape) * dtype.itemsize != info.file_size - file.tell():
                raise FileError(f"{path}: {name!r} is not what its size says")
        with archive.open(info) as file:
            return np.lib.format.read_array(file, allow_pickle=False)
    except (KeyError, ValueError, zipfile.BadZipFile, EOFError) as error:
        raise FileError(f"{path}: {name!r} is damaged") from error
