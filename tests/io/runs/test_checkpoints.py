"""Checkpoints: arrays and texts come back as they were, and a file that is cut off is refused by name."""

import numpy as np
import pytest

from urbanjax.io.runs.checkpoints import read_checkpoint, write_checkpoint
from urbanjax.types import FileError

ARRAYS = {
    "none": np.zeros((0, 3)),
    "one": np.array(3),
    "many": np.arange(6.0).reshape(2, 3),
    "turned": np.arange(6.0).reshape(2, 3).T,
    "unknown": np.array([np.nan, -np.inf]),
}


def test_everything_comes_back_as_it_was(tmp_path):
    path = tmp_path / "a.safetensors"
    write_checkpoint(path, ARRAYS, about={"of": "a test", "empty": ""})
    arrays, about = read_checkpoint(path)
    assert about == {"of": "a test", "empty": ""}
    assert set(arrays) == set(ARRAYS)
    for name, value in ARRAYS.items():
        assert arrays[name].dtype == value.dtype
        assert arrays[name].shape == value.shape
        np.testing.assert_array_equal(arrays[name], value)


def test_the_file_of_before_stays_where_a_new_one_cannot_be_written(tmp_path, monkeypatch):
    path = tmp_path / "a.safetensors"
    write_checkpoint(path, ARRAYS, about={})

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(FileError, match=r"a\.safetensors: cannot be written \(No space left on device\)"):
        write_checkpoint(path, {"other": np.ones(2)}, about={})
    monkeypatch.undo()
    assert set(read_checkpoint(path)[0]) == set(ARRAYS)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("kept", [0, 4, 20, -3])
def test_a_file_that_is_cut_off_is_refused_by_name(kept, tmp_path):
    path = tmp_path / "a.safetensors"
    write_checkpoint(path, ARRAYS, about={})
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(FileError, match=r"a\.safetensors"):
        read_checkpoint(path)


def test_a_file_that_there_is_not_is_refused(tmp_path):
    with pytest.raises(FileError, match="no such file"):
        read_checkpoint(tmp_path / "none.safetensors")
