"""Road graphs on disk: one npz file of plain arrays, with a JSON header; nothing in it is ever executed."""

import os
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from urbanjax.io import archive
from urbanjax.roadmap.graph import RoadGraph, RoadType, Rule, Turn
from urbanjax.types import FileError

FORMAT, VERSION = "urbanjax road graph", 1
MAX_COORDINATE = 1e6  # m
MAX_SIZE = 1 << 24  # of an axis
ROUNDING = 1e-2  # m, by which stations may be off

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
    """Writes the graph as npz, whole or not at all.

    Args: path of the file; graph, the road graph. Raises FileError where the file cannot be written.
    """
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
    archive.save(path, header, arrays=arrays)


def load(path: str | os.PathLike[str]) -> RoadGraph:
    """The graph in the npz file, floats in the default dtype.

    Sizes, shapes, types, finiteness and ranges are checked before anything is computed; raises FileError with the
    file's name and the key that is wrong.
    Args: path of the file.
    """
    path = Path(path)
    header, arrays = archive.load(path, FORMAT, version=VERSION, names=LAYOUT)
    _check_header(path, header)
    for name, (kind, axes) in LAYOUT.items():
        shape = tuple(2 if axis == "2" else header["sizes"][axis] for axis in axes)
        archive.expect(path, name, array=arrays[name], kind=kind, shape=shape)
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


def _check_header(path: Path, header: dict[str, Any]) -> None:
    sizes, origin, areas = (header.get(key) for key in ("sizes", "origin", "area_names"))
    if not isinstance(sizes, dict) or not all(_is_int(sizes.get(key), 1) for key in "LPSXY") or sizes["P"] < 2:
        raise FileError(f"{path}: 'header' has no valid sizes L, P, S, X, Y")
    if not isinstance(origin, list) or len(origin) != 2 or not all(archive.is_finite(x) for x in origin):
        raise FileError(f"{path}: 'header' has no origin of two finite numbers")
    if not isinstance(areas, list) or not areas or not all(isinstance(name, str) for name in areas):
        raise FileError(f"{path}: 'header' has no list of area names")
    if not _is_int(header.get("n_signals"), 0):
        raise FileError(f"{path}: 'header' has no number of signals")


def _is_int(x: Any, least: int) -> bool:
    return isinstance(x, int) and not isinstance(x, bool) and least <= x <= MAX_SIZE


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
            arrays["station"], length[:, None] * np.linspace(0, 1, header["sizes"]["P"]), atol=ROUNDING
        ),
        "stop_line": np.any((arrays["stop_line"] < 0) | (arrays["stop_line"] > length[:, None] + ROUNDING)),
        "has_signal": header["n_signals"] == 0 and np.any(arrays["has_signal"]),
        "valid": not np.any(arrays["valid"]),
    }
    for name, wrong in faults.items():
        if wrong:
            raise FileError(f"{path}: {name!r} is out of range")
    for name in ("successor", "predecessor", "opposite", "conflict"):
        if np.any(arrays[f"has_{name}"] & ~(arrays["valid"][:, None] & arrays["valid"][arrays[name]])):
            raise FileError(f"{path}: 'has_{name}' is true where a link is not valid")
