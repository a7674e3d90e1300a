"""Road graphs survive the disk unchanged; damaged, foreign and hostile files are refused by file and key."""

import json
import zipfile

import jax
import numpy as np
import pytest

from urbanjax.io.maps import roadgraph
from urbanjax.roadmap import builders
from urbanjax.types import FileError


@pytest.fixture(scope="module")
def graph():
    return builders.intersection(n_lanes=1, n_points=8)


@pytest.fixture
def stored(graph, tmp_path):
    """A saved graph's path, its arrays, and a function that writes changed arrays there."""
    path = tmp_path / "map.npz"
    roadgraph.save(path, graph)
    with np.load(path, allow_pickle=False) as file:
        arrays = dict(file)

    def write(**changes):
        np.savez(path, **{k: v for k, v in (arrays | changes).items() if v is not None})

    return path, arrays, write


def test_round_trip_is_exact(graph, stored):
    loaded = roadgraph.load(stored[0])
    assert jax.tree.structure(loaded) == jax.tree.structure(graph)
    for a, b in zip(jax.tree.leaves(loaded), jax.tree.leaves(graph), strict=True):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)


def test_every_array_of_the_graph_is_stored(graph):
    stored = set(roadgraph.LAYOUT)
    assert stored == {name for name in vars(graph) if name not in ("origin", "area_names", "n_signals")}


def spoiled(array, index, value):
    out = array.copy()
    out[index] = value
    return out


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("centre", lambda a: spoiled(a, (0, 0, 0), np.nan)),
        ("centre", lambda a: a * 1e9),
        ("heading", lambda a: a[:, :-1]),
        ("heading", lambda a: a.astype(np.int32)),
        ("successor", lambda a: spoiled(a, (0, 0), 10_000)),
        ("successor", lambda a: spoiled(a, (0, 0), -1)),
        ("left_link", lambda a: spoiled(a, 0, -5)),
        ("turn", lambda a: spoiled(a, 0, 77)),
        ("area", lambda a: spoiled(a, 0, 1000)),
        ("signal", lambda a: spoiled(a, (0, 0), 4)),
        ("speed_limit", lambda a: a * 0),
        ("length", lambda a: -a),
        ("station", lambda a: a[:, ::-1]),
        ("stop_line", lambda a: a + 1e3),
        ("valid", np.zeros_like),
        ("has_left", lambda a: None),
        ("has_successor", lambda a: a.astype(float)),
    ],
)
def test_wrong_array_is_refused_by_key(stored, key, change):
    path, arrays, write = stored
    write(**{key: change(arrays[key])})
    with pytest.raises(FileError, match=rf"map\.npz: .*'{key}'"):
        roadgraph.load(path)


def header(arrays, **changes):
    text = json.dumps(json.loads(arrays["header"].tobytes()) | changes)
    return np.frombuffer(text.encode(), np.uint8)


@pytest.mark.parametrize(
    "changes",
    [
        {"format": "other"},
        {"version": 99},
        {"sizes": {"L": 1}},
        {"sizes": None},
        {"origin": [0]},
        {"origin": [0, 1e999]},
        {"area_names": [1]},
        {"n_signals": -1},
        {"n_signals": True},
    ],
)
def test_wrong_header_is_refused(stored, changes):
    path, arrays, write = stored
    write(header=header(arrays, **changes))
    with pytest.raises(FileError, match="'header'"):
        roadgraph.load(path)


def test_header_that_is_no_json_is_refused(stored):
    path, _, write = stored
    write(header=np.frombuffer(b"{]", np.uint8))
    with pytest.raises(FileError, match="is not JSON"):
        roadgraph.load(path)


def test_missing_foreign_and_truncated_files_are_refused(stored, tmp_path):
    path, *_ = stored
    with pytest.raises(FileError, match="no such file"):
        roadgraph.load(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("not a zip")
    with pytest.raises(FileError, match="not a readable npz"):
        roadgraph.load(tmp_path / "text.npz")
    path.write_bytes(path.read_bytes()[:-2000])
    with pytest.raises(FileError, match="npz"):
        roadgraph.load(path)


def test_pickled_objects_are_refused(stored):
    path, _, write = stored
    write(turn=np.array([{"a": 1}], dtype=object))
    with pytest.raises(FileError, match="'turn'"):
        roadgraph.load(path)


def test_announced_size_beyond_the_file_takes_no_memory(stored):
    path, _, _ = stored
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    start = parts["centre.npy"].index(b"'shape': (") + len(b"'shape': (")
    end = parts["centre.npy"].index(b")", start)
    claim = b"9999999, 999, 2".ljust(end - start)
    parts["centre.npy"] = parts["centre.npy"][:start] + claim[: end - start] + parts["centre.npy"][end:]
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in parts.items():
            archive.writestr(name, data)
    with pytest.raises(FileError, match="'centre'"):
        roadgraph.load(path)


def test_unwritable_place_is_refused(graph, tmp_path):
    with pytest.raises(FileError, match="cannot be written"):
        roadgraph.save(tmp_path / "no" / "map.npz", graph)
