"""Point clouds from files: PLY, PCD, KITTI bin and npz; every file is checked before anything is used."""

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np

from urbanjax.io.clouds.pcd import read_pcd
from urbanjax.io.files import LARGEST, content, file_of
from urbanjax.types import FileError
from urbanjax.types.arguments import array as as_numbers
from urbanjax.types.arguments import short

FARTHEST = 1e7  # m from the origin, as of what `register` takes
PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip


def read(path: str | Path, array: str | None = None) -> np.ndarray:
    """The points [N, 3] (m, float64) of a file, by its suffix: ply, pcd, bin (KITTI) or npz.

    Args: path of the file; array, its name in an npz file (default: xyz, or the only one). Raises FileError, naming the
    file, if it is missing, empty, truncated, enormous or not what its suffix says, and if a coordinate is not finite or
    too far from the origin.
    """
    path = file_of(path)
    if array is not None and not isinstance(array, str):
        raise FileError(f"{path}: array is {short(array)}: give the name of an array")
    if path.suffix.lower() not in READERS:
        raise FileError(f"{path}: no reader for '{path.suffix}'; use one of {', '.join(READERS)}")
    reader = READERS[path.suffix.lower()]
    points = read_npz(path, array) if reader is read_npz else reader(path)
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        raise FileError(f"{path}: holds no points [N, 3], but an array of shape {points.shape}")
    if not np.isfinite(points).all():
        raise FileError(f"{path}: {int((~np.isfinite(points)).any(1).sum())} points are not finite; remove them")
    if np.abs(points).max() > FARTHEST:
        raise FileError(
            f"{path}: holds a coordinate of {np.abs(points).max():.3g} m, beyond {FARTHEST:g}: it is no scan in "
            "metres, or no such file"
        )
    return points


def read_kitti(path: Path) -> np.ndarray:
    """x, y, z of a KITTI scan: float32 x, y, z, reflectance.

    Args: path of the file.
    """
    data = content(path)
    if len(data) % 16:  # four floats of 4 bytes
        raise FileError(f"{path}: {len(data)} bytes are no whole number of float32 (x, y, z, reflectance); truncated?")
    return np.frombuffer(data, "<f4").reshape(-1, 4)[:, :3].astype(float)


def read_npz(path: Path, array: str | None = None) -> np.ndarray:
    """A named array of an npz file, else xyz or the only one; leading axes are joined, empty returns (0, 0, 0) dropped.

    Args: path of the file; array, its name.
    """
    try:
        with np.load(io.BytesIO(content(path)), allow_pickle=False) as archive:
            names = archive.files
            name = array or ("xyz" if len(names) != 1 else names[0])
            if name not in names:
                raise FileError(f"{path}: has no array '{name}' among {', '.join(names)}")
            if archive.zip.getinfo(f"{name}.npy").file_size > LARGEST:
                raise FileError(f"{path}: '{name}' unpacks to more than {LARGEST} bytes")
            points = as_numbers(archive[name], f"{path}: '{name}'", error=FileError)
    except FileError:
        raise
    except Exception as error:
        raise FileError(f"{path}: is no npz file of numbers: {str(error).splitlines()[0]}") from error
    if points.shape[-1:] != (3,):
        raise FileError(f"{path}: '{name}' has the shape {points.shape}; the last axis must be x, y, z")
    points = points.reshape(-1, 3)
    return points[np.any(points != 0, axis=1)]


def read_ply(path: Path) -> np.ndarray:
    """x, y, z of the vertices of a PLY file, ascii or binary.

    Args: path of the file.
    """
    data = content(path)
    end = data.find(b"end_header")
    if not data.startswith(b"ply") or end < 0:
        raise FileError(f"{path}: is no PLY file: it has no header")
    body = data[data.find(b"\n", end) + 1 :]
    kind, count, columns = _ply_header(path, data[:end].decode("ascii", "replace"))
    names = [name for name, _ in columns]
    missing = {"x", "y", "z"} - set(names)
    if missing:
        raise FileError(f"{path}: its vertices have no {', '.join(sorted(missing))}")
    if kind == "ascii":
        return _ply_ascii(path, body, count, names)
    order = "<" if kind == "binary_little_endian" else ">"
    row = np.dtype([(name, order + code) for name, code in columns])
    if len(body) < count * row.itemsize:
        raise FileError(f"{path}: {count} vertices need {count * row.itemsize} bytes, but {len(body)} are left")
    table = np.frombuffer(body, row, count)
    return np.stack([table[name].astype(float) for name in "xyz"], axis=1)


def _ply_header(path: Path, text: str) -> tuple[str, int, list[tuple[str, str]]]:
    """Encoding, number of vertices, and name and type of their properties."""
    kind, count, columns, element = "", -1, [], ""
    for line in text.splitlines():
        words = line.split()
        if words[:1] == ["format"]:
            kind = words[1] if len(words) > 1 else ""
        elif words[:1] == ["element"]:
            if count < 0 and words[1:2] != ["vertex"]:
                raise FileError(f"{path}: its first element is '{' '.join(words[1:2])}'; put the vertices first")
            element = " ".join(words[1:2])
            if element == "vertex":
                count = int(words[2]) if len(words) > 2 and words[2].isdigit() else -1
        elif words[:1] == ["property"] and element == "vertex":
            if len(words) != 3 or words[1] not in PLY_TYPES:
                raise FileError(f"{path}: cannot read the vertex property '{' '.join(words[1:])}'")
            if words[2] in dict(columns):
                raise FileError(f"{path}: has the vertex property '{words[2]}' twice")
            columns.append((words[2], PLY_TYPES[words[1]]))
    if kind not in ("ascii", "binary_little_endian", "binary_big_endian") or count < 0:
        raise FileError(f"{path}: its header names no known format or no number of vertices")
    return kind, count, columns


def _ply_ascii(path: Path, body: bytes, count: int, names: list[str]) -> np.ndarray:
    rows = body.decode("ascii", "replace").split("\n")[:count]
    try:
        table = np.array([row.split() for row in rows], float).reshape(count, len(names))
    except ValueError as error:
        raise FileError(f"{path}: {count} rows of {len(names)} numbers were promised; truncated?") from error
    return table[:, [names.index(name) for name in "xyz"]]


READERS: dict[str, Callable[..., np.ndarray]] = {
    ".ply": read_ply,
    ".pcd": read_pcd,
    ".bin": read_kitti,
    ".npz": read_npz,
}
