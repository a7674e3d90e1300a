"""Point clouds come back as they were written; what is wrong with a file is said in one line."""

import numpy as np
import pytest

from urbanjax.io import files
from urbanjax.io.clouds import pointclouds
from urbanjax.types import FileError

POINTS = np.random.default_rng(0).normal(size=(20, 3)).astype(np.float32)


def ply(kind: str, rows: bytes, count: int = 20, columns: tuple[str, ...] = ("x", "y", "z", "intensity")) -> bytes:
    lines = ["ply", f"format {kind} 1.0", f"element vertex {count}", *(f"property float {c}" for c in columns)]
    return "\n".join([*lines, "end_header", ""]).encode() + rows


def table(order: str) -> bytes:
    return np.hstack([POINTS, np.ones((20, 1))]).astype(f"{order}f4").tobytes()


def pcd(kind: str, rows: bytes, fields: str = "x y z intensity", points: int = 20) -> bytes:
    head = ["# .PCD v0.7", "VERSION 0.7", f"FIELDS {fields}", "SIZE 4 4 4 4", "TYPE F F F F", "COUNT 1 1 1 1"]
    return "\n".join([*head, f"WIDTH {points}", "HEIGHT 1", f"POINTS {points}", f"DATA {kind}", ""]).encode() + rows


def packed(rows: bytes) -> bytes:
    """Field by field in LZF: literals, and one long reference for the ones of the last field."""
    columns = np.frombuffer(rows, "<f4").reshape(20, 4).T
    literal = columns[:3].tobytes() + columns[3, :1].tobytes()
    out = b"".join(bytes([len(part) - 1]) + part for part in (literal[i : i + 32] for i in range(0, len(literal), 32)))
    out += bytes([7 << 5, 76 - 2 - 7, 3])  # 76 bytes from 4 back
    return np.array([len(out), len(rows)], "<u4").tobytes() + out


def written(folder, name: str, data: bytes):
    path = folder / name
    path.write_bytes(data)
    return path


def test_every_format_gives_the_points_back(tmp_path):
    ascii_rows = "\n".join(" ".join(map(repr, [*map(float, row), 1.0])) for row in POINTS).encode()
    paths = [
        written(tmp_path, "little.ply", ply("binary_little_endian", table("<"))),
        written(tmp_path, "big.ply", ply("binary_big_endian", table(">"))),
        written(tmp_path, "text.ply", ply("ascii", ascii_rows)),
        written(tmp_path, "scan.bin", table("<")),
        written(tmp_path, "text.pcd", pcd("ascii", ascii_rows)),
        written(tmp_path, "binary.pcd", pcd("binary", table("<"))),
        written(tmp_path, "packed.pcd", pcd("binary_compressed", packed(table("<")))),
        tmp_path / "scan.npz",
    ]
    np.savez(tmp_path / "scan.npz", xyz=np.concatenate([POINTS, np.zeros((4, 3))]).reshape(4, 6, 3))
    for path in paths:
        np.testing.assert_allclose(pointclouds.read(path), POINTS, rtol=1e-6)


def test_a_named_array_of_an_archive(tmp_path):
    np.savez(tmp_path / "two.npz", a=POINTS, b=POINTS[:3])
    assert len(pointclouds.read(tmp_path / "two.npz", "b")) == 3
    with pytest.raises(FileError, match="has no array 'xyz' among a, b"):
        pointclouds.read(tmp_path / "two.npz")
    np.savez(tmp_path / "one.npz", a=POINTS)
    assert len(pointclouds.read(tmp_path / "one.npz")) == 20
    with pytest.raises(FileError, match="has no array 'zzz' among a"):
        pointclouds.read(tmp_path / "one.npz", "zzz")
    for wrong in (POINTS > 0, POINTS * 1j):
        np.savez(tmp_path / "wrong.npz", xyz=wrong)
        with pytest.raises(FileError, match=r"wrong.npz: 'xyz': ndarray is no array of real numbers"):
            pointclouds.read(tmp_path / "wrong.npz")


BAD = {
    "no such file": ("none.bin", None, "there is no such file"),
    "unknown suffix": ("scan.las", b"", r"no reader for '\.las'; use one of \.ply, \.pcd, \.bin, \.npz"),
    "truncated scan": ("scan.bin", table("<")[:-3], "no whole number"),
    "empty scan": ("scan.bin", b"", "holds no points"),
    "no header": ("scan.ply", b"x y z", "no PLY file"),
    "truncated vertices": ("scan.ply", ply("binary_little_endian", table("<")[:-1]), "need 320 bytes, but 319"),
    "truncated text": ("scan.ply", ply("ascii", b"1 2 3 4\n1 2"), "20 rows of 4 numbers"),
    "no z": ("scan.ply", ply("binary_little_endian", table("<"), columns=("x", "y", "a", "b")), "have no z"),
    "unknown format": ("scan.ply", ply("zip", table("<")), "no known format"),
    "huge count": ("scan.ply", ply("binary_little_endian", table("<"), count=10**12), "bytes, but 320 are left"),
    "a list": ("scan.ply", ply("ascii", b"").replace(b"float x", b"list uchar int x"), "cannot read the vertex"),
    "no PCD": ("scan.pcd", b"x y z", "no PCD file"),
    "truncated PCD": ("scan.pcd", pcd("binary", table("<")[:-1]), "need 320 bytes, but 319"),
    "truncated PCD text": ("scan.pcd", pcd("ascii", b"1 2 3 4"), "20 rows of 4 numbers"),
    "PCD without z": ("scan.pcd", pcd("binary", table("<"), "x y a b"), "have no z"),
    "unknown PCD": ("scan.pcd", pcd("zip", table("<")), "DATA is 'zip'"),
    "damaged PCD": ("scan.pcd", pcd("binary_compressed", packed(table("<"))[:-1] + b"\xff"), "damaged"),
    "short PCD": ("scan.pcd", pcd("binary_compressed", packed(table("<"))[:-5]), "truncated"),
    "huge PCD": ("scan.pcd", pcd("binary", b"", points=10**12), "but 0 are left"),
    "no points in a PCD": ("scan.pcd", pcd("binary", table("<")).replace(b"POINTS 20\n", b""), "how many POINTS"),
    "an empty field": ("scan.pcd", pcd("binary", table("<")).replace(b"COUNT 1", b"COUNT 0"), "COUNT 0 cannot be read"),
    "x twice": ("scan.ply", ply("binary_little_endian", table("<"), columns=("x", "x", "y", "z")), "'x' twice"),
    "a nameless element": ("scan.ply", ply("ascii", b"").replace(b"end_header", b"element\nend_header"), "20 rows"),
    "not finite": ("scan.bin", np.full(8, np.nan, "<f4").tobytes(), "2 points are not finite"),
    "no points": ("scan.pcd", pcd("binary", b"", points=0), "holds no points"),
    "WIDTH": ("scan.pcd", pcd("binary", table("<")).replace(b"WIDTH 20", b"WIDTH x"), "WIDTH or HEIGHT is 'x'"),
    "HEIGHT": ("scan.pcd", pcd("binary", table("<")).replace(b"WIDTH 20", b"WIDTH 3"), "WIDTH 3 times HEIGHT 1 is not"),
    "no scan": ("scan.bin", b"this is text, no scan, at all!!!" * 2, r"holds a coordinate of .* m, beyond 1e\+07"),
    "no archive": ("scan.npz", b"PK but no more", "no npz file"),
}


@pytest.mark.parametrize(("name", "data", "message"), BAD.values(), ids=BAD)
def test_a_bad_file_is_named_in_one_line(name, data, message, tmp_path):
    path = tmp_path / name
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(FileError, match=message) as caught:
        pointclouds.read(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_enormous_file_is_refused_unread(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "LARGEST", 100)
    with pytest.raises(FileError, match="more than the 100"):
        pointclouds.read(written(tmp_path, "scan.bin", table("<")))


def test_an_archive_of_objects_is_refused(tmp_path):
    np.savez(tmp_path / "objects.npz", xyz=np.array([{}, []], dtype=object))
    with pytest.raises(FileError, match="no npz file of numbers"):
        pointclouds.read(tmp_path / "objects.npz")


def test_an_archive_that_unpacks_to_too_much_is_refused(tmp_path, monkeypatch):
    np.savez_compressed(tmp_path / "bomb.npz", xyz=np.ones((1000, 3)))
    monkeypatch.setattr(pointclouds, "LARGEST", 10_000)
    with pytest.raises(FileError, match="unpacks to more than 10000 bytes"):
        pointclouds.read(tmp_path / "bomb.npz")


def test_a_folder_is_no_file(tmp_path):
    (tmp_path / "scans.bin").mkdir()
    with pytest.raises(FileError, match="is a folder: name a file in it"):
        pointclouds.read(tmp_path / "scans.bin")
