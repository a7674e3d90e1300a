"""Road graphs on disk: one npz file of plain arrays, with a JSON header; nothing in it is ever executed."""

import json
import math
import os
import zipfile
import zlib
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from urbanjax.roadmap.graph import RoadGraph, RoadType, Rule, Turn
from urbanjax.types import FileError

FORMAT, VERSION = "urbanjax road graph", 1
MAX_BYTES = 1 << 30  # of all arrays together
MAX_HEADER = 1 << 22  # bytes of JSON
MAX_COORDINATE = 1e6  # m

# Kind (float, integer, bool) and axes of every array: Links, Points, Successors, relations X, signals per link Y.
LAYOUT = {
    **dict.fromkeys(("centre", "left", "right"), ("f", "LP2")),
    **dict.fromkeys(("heading", "curvature", "station", "left_station", "right_station"), ("f", "LP")),
    **dict.fromkeys(("length", "speed_limit"), ("f", "L")),
    **dict.fromkeys(("turn", "road_type", "rule", "left_link", "right_link", "area"), ("i", "L")),
    **dict.fromkeys(("valid", "has_left", "left_change", "has_right", "right_change"), ("b", "L")),
    **dict.fromkeys(("successor", "predecessor"), ("i", "LS")),
    **dict.fromkeys(("has_successor", "has_predecessor"), ("b", "LS")),
    **dict.fromkeys(("opposite", "conflict"), ("i", "LX")),
    **dict.fromkeys(("has_opposite", "has_conflict"), ("b", "LX")),
    "opposite_offset": ("f", "LX"),
    "signal": ("i", "LY"),
    "has_signal": ("b", "LY"),
    "stop_line": ("f", "LY"),
}
STORED = {"f": np.float64, "i": np.int32, "b": np.bool_}


def save(path: str | os.PathLike[str], graph: RoadGraph) -> None:
    """Writes the graph as npz, whole or not at all. Raises FileError where the file cannot be written."""
    path = Path(path)
    arrays: dict[str, Any] = {n: np.asarray(getattr(graph, n), STORED[kind]) for n, (kind, _) in LAYOUT.items()}
    header = {
        "format": FORMAT,
        "version": VERSION,
        "sizes": {
            "L": graph.centre.shape[0],
            "P": graph.centre.shape[1],
            "S": graph.successor.shape[1],
            "X": graph.opposite.shape[1],
            "Y": graph.signal.shape[1],
        },
        "origin": list(graph.origin),
        "area_names": list(graph.area_names),
        "n_signals": graph.n_signals,
    }
    text = np.frombuffer(json.dumps(header).encode(), np.uint8)
    part = path.with_name(path.name + ".part")
    try:
        with part.open("wb") as file:
            np.savez_compressed(file, header=text, **arrays)
        part.replace(path)
    except OSError as error:
        raise FileError(f"{path}: cannot be written ({error.strerror})") from error


def load(path: str | os.PathLike[str]) -> RoadGraph:
    """The graph in the npz file, floats in the default dtype.

    Sizes, shapes, types, finiteness and ranges are checked before anything is computed; raises FileError with the
    file's name and the key that is wrong.
    """
    path = Path(path)
    try:
        with zipfile.ZipFile(path) as archive:
            header = _header(path, archive)
            arrays = {name: _array(path, archive, name, header["sizes"]) for name in LAYOUT}
    except FileNotFoundError as error:
        raise FileError(f"{path}: no such file") from error
    except (OSError, RuntimeError, zipfile.BadZipFile, EOFError, zlib.error) as error:
        raise FileError(f"{path}: is not a readable npz file ({error})") from error
    _check(path, header, arrays)
    cast = {
        "f": lambda x: jnp.asarray(x, jnp.zeros(()).dtype),
        "i": lambda x: jnp.asarray(x, jnp.int32),
        "b": jnp.asarray,
    }
    return RoadGraph(
        **{name: cast[LAYOUT[name][0]](array) for name, array in arrays.items()},
        origin=(float(header["origin"][0]), float(header["origin"][1])),
        area_names=tuple(header["area_names"]),
        n_signals=header["n_signals"],
    )


def _header(path: Path, archive: zipfile.ZipFile) -> dict[str, Any]:
    """The checked JSON header."""
    names = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
    missing = [name for name in ("header", *LAYOUT) if name not in names]
    if missing:
        raise FileError(f"{path}: key {missing[0]!r} is missing: not a road graph, or an incomplete one")
    if sum(info.file_size for info in names.values()) > MAX_BYTES or names["header"].file_size > MAX_HEADER:
        raise FileError(f"{path}: arrays of more than {MAX_BYTES >> 20} MiB: not a road graph")
    text = _read(path, archive, "header")
    try:
        header = json.loads(text.astype(np.uint8).tobytes())
    except (ValueError, RecursionError) as error:
        raise FileError(f"{path}: 'header' is not JSON") from error
    if not isinstance(header, dict) or header.get("format") != FORMAT or header.get("version") != VERSION:
        raise FileError(f"{path}: 'header' does not say {FORMAT!r}, version {VERSION}")
    sizes, origin, areas = (header.get(key) for key in ("sizes", "origin", "area_names"))
    if not isinstance(sizes, dict) or not all(_is_int(sizes.get(key), 1) for key in "LPSXY") or sizes["P"] < 2:
        raise FileError(f"{path}: 'header' has no valid sizes L, P, S, X, Y")
    if not isinstance(origin, list) or len(origin) != 2 or not all(_is_finite(x) for x in origin):
        raise FileError(f"{path}: 'header' has no origin of two finite numbers")
    if not isinstance(areas, list) or not areas or not all(isinstance(name, str) for name in areas):
        raise FileError(f"{path}: 'header' has no list of area names")
    if not _is_int(header.get("n_signals"), 0):
        raise FileError(f"{path}: 'header' has no number of signals")
    return header


def _is_int(x: Any, least: int) -> bool:
    return isinstance(x, int) and not isinstance(x, bool) and least <= x <= 1 << 24


def _is_finite(x: Any) -> bool:
    return isinstance(x, int | float) and not isinstance(x, bool) and math.isfinite(x)


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


def _array(path: Path, archive: zipfile.ZipFile, name: str, sizes: dict[str, int]) -> np.ndarray:
    """One array of the expected kind and shape, without non-finite numbers."""
    kind, axes = LAYOUT[name]
    array = _read(path, archive, name)
    shape = tuple(2 if axis == "2" else sizes[axis] for axis in axes)
    if array.dtype.kind != kind or array.shape != shape:
        raise FileError(f"{path}: {name!r} is {array.dtype} {array.shape}, expected kind {kind!r} and shape {shape}")
    if kind == "f" and not np.all(np.isfinite(array)):
        raise FileError(f"{path}: {name!r} has non-finite numbers")
    return array


def _check(path: Path, header: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    """Ranges of numbers and indices."""
    n_links = header["sizes"]["L"]
    counts = {
        **dict.fromkeys(("successor", "predecessor", "left_link", "right_link", "opposite", "conflict"), n_links),
        "turn": len(Turn),
        "road_type": len(RoadType),
        "rule": len(Rule),
        "area": len(header["area_names"]),
        "signal": max(header["n_signals"], 1),
    }
    for name, count in counts.items():
        if np.any((arrays[name] < 0) | (arrays[name] >= count)):
            raise FileError(f"{path}: {name!r} is not within 0..{count - 1}")
    length = arrays["length"]
    faults = {
        "centre": np.abs(arrays["centre"]).max() > MAX_COORDINATE,
        "left": np.abs(arrays["left"]).max() > MAX_COORDINATE,
        "right": np.abs(arrays["right"]).max() > MAX_COORDINATE,
        "length": np.any(length <= 0),
        "speed_limit": np.any(arrays["speed_limit"] <= 0),
        "station": not np.allclose(
            arrays["station"], length[:, None] * np.linspace(0, 1, header["sizes"]["P"]), atol=1e-2
        ),
        "stop_line": np.any((arrays["stop_line"] < 0) | (arrays["stop_line"] > length[:, None] + 1e-2)),
        "has_signal": header["n_signals"] == 0 and np.any(arrays["has_signal"]),
        "valid": not np.any(arrays["valid"]),
    }
    for name, wrong in faults.items():
        if wrong:
            raise FileError(f"{path}: {name!r} is out of range")
    for name in ("successor", "predecessor", "opposite", "conflict"):
        if np.any(arrays[f"has_{name}"] & ~(arrays["valid"][:, None] & arrays["valid"][arrays[name]])):
            raise FileError(f"{path}: 'has_{name}' is true where a link is not valid")
