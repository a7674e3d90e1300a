"""PCD files of the Point Cloud Library: ascii, binary and binary_compressed."""

from pathlib import Path

import numpy as np

from urbanjax.io.files import content
from urbanjax.types import FileError

KINDS = {"F": "f", "I": "i", "U": "u"}
LONGEST_LINE = 10_000  # bytes of a header's line
SIZES = {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}


def read_pcd(path: Path) -> np.ndarray:
    """x, y, z [N, 3] of a PCD file, without the points that it marks as missing by NaN.

    Args: path of the file. Raises FileError.
    """
    header, body = _header(path, content(path))
    row = _row(path, header)
    missing = {"x", "y", "z"} - set(row.names or ())
    if missing:
        raise FileError(f"{path}: its points have no {', '.join(sorted(missing))}")
    count = _count(path, header)
    encoding = " ".join(header["DATA"])
    if encoding == "ascii":
        table = _ascii(path, body, count, row)
    elif encoding == "binary":
        _enough(path, len(body), count * row.itemsize)
        table = np.frombuffer(body, row, count)
    elif encoding == "binary_compressed":
        table = _compressed(path, body, count, row)
    else:
        raise FileError(f"{path}: DATA is '{encoding}'; use ascii, binary or binary_compressed")
    points = np.stack([np.asarray(table[name], float).reshape(count, -1)[:, 0] for name in "xyz"], axis=1)
    return points[~np.isnan(points).any(axis=1)]


def _header(path: Path, data: bytes) -> tuple[dict[str, list[str]], bytes]:
    """The header's lines by their first word, and what follows them."""
    header: dict[str, list[str]] = {}
    start = 0
    while "DATA" not in header:
        end = data.find(b"\n", start)
        if end < 0 or end - start > LONGEST_LINE:
            raise FileError(f"{path}: is no PCD file: its header has no DATA line")
        words = data[start:end].decode("ascii", "replace").split()
        start = end + 1
        if words and not words[0].startswith("#"):
            header[words[0].upper()] = words[1:]
    for name in ("FIELDS", "SIZE", "TYPE"):
        if name not in header:
            raise FileError(f"{path}: its header has no {name} line")
    return header, data[start:]


def _row(path: Path, header: dict[str, list[str]]) -> np.dtype:
    """The type of one point."""
    names, sizes, kinds = header["FIELDS"], header["SIZE"], header["TYPE"]
    counts = header.get("COUNT", ["1"] * len(names))
    if not len(names) == len(sizes) == len(kinds) == len(counts):
        raise FileError(f"{path}: FIELDS, SIZE, TYPE and COUNT differ in length")
    fields = []
    for i, (name, size, kind, count) in enumerate(zip(names, sizes, kinds, counts, strict=True)):
        known = kind in KINDS and size.isdigit() and int(size) in SIZES[kind]
        if not known or not count.isdigit() or int(count) < 1:
            raise FileError(f"{path}: field '{name}' of TYPE {kind}, SIZE {size} and COUNT {count} cannot be read")
        label = name if name not in names[:i] and name != "_" else f"{name} {i}"
        fields.append((label, f"<{KINDS[kind]}{size}", (int(count),)))
    return np.dtype(fields)


def _count(path: Path, header: dict[str, list[str]]) -> int:
    words = header.get("POINTS", [])
    if len(words) != 1 or not words[0].isdigit():
        raise FileError(f"{path}: its header does not say how many POINTS there are")
    count = int(words[0])
    if not count:
        raise FileError(f"{path}: holds no points (POINTS 0)")
    sizes = [header[name] for name in ("WIDTH", "HEIGHT") if name in header]
    for words in sizes:
        if len(words) != 1 or not words[0].isdigit():
            raise FileError(f"{path}: its WIDTH or HEIGHT is {' '.join(words)[:40]!r}, which is no whole number")
    if len(sizes) == 2 and int(sizes[0][0]) * int(sizes[1][0]) != count:
        raise FileError(f"{path}: WIDTH {sizes[0][0]} times HEIGHT {sizes[1][0]} is not the {count} of POINTS")
    return count


def _enough(path: Path, have: int, need: int) -> None:
    if have < need:
        raise FileError(f"{path}: its points need {need} bytes, but {have} are left; truncated?")


def _ascii(path: Path, body: bytes, count: int, row: np.dtype) -> np.ndarray:
    columns = sum(row[name].shape[0] for name in row.names or ())
    lines = body.decode("ascii", "replace").split("\n")[:count]
    try:
        numbers = np.array([line.split() for line in lines], float).reshape(count, columns)
    except ValueError as error:
        raise FileError(f"{path}: {count} rows of {columns} numbers were promised; truncated?") from error
    table, at = np.zeros(count, row), 0
    for name in row.names or ():
        width = row[name].shape[0]
        if name in ("x", "y", "z"):
            table[name] = numbers[:, at : at + width]
        at += width
    return table


def _compressed(path: Path, body: bytes, count: int, row: np.dtype) -> np.ndarray:
    """Field by field, packed by LZF."""
    _enough(path, len(body), 8)  # two sizes of 4 bytes
    packed, size = (int(x) for x in np.frombuffer(body, "<u4", 2))
    _enough(path, len(body) - 8, packed)
    if size != count * row.itemsize:
        raise FileError(f"{path}: its points need {count * row.itemsize} bytes, but {size} are packed")
    plain = _unpack(path, body[8 : 8 + packed], size)
    table, at = np.zeros(count, row), 0
    for name in row.names or ():
        part = count * row[name].itemsize
        table[name] = np.frombuffer(plain, row[name].base, count * row[name].shape[0], at).reshape(count, -1)
        at += part
    return table


def _unpack(path: Path, packed: bytes, size: int) -> bytes:
    """LZF: runs of literal bytes, and references to bytes that have come out before.

    A control byte below 32 begins a run of one more byte than it says. Any other holds the length less 2 of a reference
    in its upper 3 bits (7: a byte with more of it follows) and the high part of the distance back in its lower 5.
    """
    out, at = bytearray(), 0
    try:
        while at < len(packed) and len(out) <= size:
            control = packed[at]
            at += 1
            if control < 32:
                out += packed[at : at + control + 1]
                at += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += packed[at]
                at += 1
            start = len(out) - ((control & 31) << 8) - packed[at] - 1
            at += 1
            if start < 0:
                raise IndexError
            for k in range(start, start + length + 2):  # may overlap what it writes
                out.append(out[k])
    except IndexError as error:
        raise FileError(f"{path}: its packed points are damaged") from error
    if len(out) != size:
        raise FileError(f"{path}: its packed points are damaged: {len(out)} bytes instead of {size}")
    return bytes(out)
