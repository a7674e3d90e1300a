"""A run's directory: manifest last and whole, results kept on failure, nothing overwritten."""

import json

import numpy as np
import pyarrow.parquet
import pytest

from urbanjax.io.runs import directory as runs


def read(path):
    return json.loads(path.read_text())


def test_manifest_says_what_ran(tmp_path, capsys):
    with runs.record(tmp_path / "run", {"b": 1, "a": [2.0]}, seed=3) as run:
        assert not run.path("manifest.json").exists()
        run.table("t", {"k": np.arange(2), "v": [0.5, None]})
    manifest = read(run.path("manifest.json"))
    assert manifest["status"] == "complete"
    assert manifest["seed"] == 3
    assert manifest["config"] == {"b": 1, "a": [2.0]}
    assert manifest["files"] == ["t.csv", "t.parquet"]
    assert manifest["versions"]["jax"]
    assert manifest["device"]["platform"] == "cpu"
    assert manifest["wall_time_s"] >= 0
    assert {"commit", "dirty"} == set(manifest["git"])
    assert "python" in manifest["command"]
    assert capsys.readouterr().out.splitlines()[-1].startswith("run directory: ")


def test_config_hash_does_not_depend_on_the_order_of_keys(tmp_path):
    first = runs.Run(tmp_path / "a", {"x": 1, "y": 2}).manifest()
    second = runs.Run(tmp_path / "b", {"y": 2, "x": 1}).manifest()
    third = runs.Run(tmp_path / "c", {"y": 2, "x": 3}).manifest()
    assert first["config_sha256"] == second["config_sha256"] != third["config_sha256"]


def test_a_failed_run_keeps_what_it_had_and_says_why(tmp_path):
    def body():
        with runs.record(tmp_path / "run", {}) as run:
            run.summary({"speed_mps": 1})
            raise ValueError("no\nmore")

    with pytest.raises(ValueError, match="no\nmore"):
        body()
    assert read(tmp_path / "run" / "summary.json") == {"speed_mps": 1}
    manifest = read(tmp_path / "run" / "manifest.json")
    assert manifest["status"] == "failed"
    assert manifest["error"] == "ValueError: no more"


def test_a_second_run_does_not_overwrite_the_first(tmp_path):
    with runs.record(tmp_path / "run", {}) as first:
        pass
    with runs.record(tmp_path / "run", {}) as second:
        pass
    assert first.directory != second.directory


def test_writing_is_all_or_nothing(tmp_path, monkeypatch):
    target = tmp_path / "manifest.json"
    runs.write_atomically(target, "old")

    def fail(*_):
        raise OSError("disk full")

    monkeypatch.setattr(runs.os, "fsync", fail)
    with pytest.raises(OSError, match="disk full"):
        runs.write_atomically(target, "new")
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_tables_are_written_twice_alike(tmp_path):
    run = runs.Run(tmp_path / "run", {})
    columns = {"name": ["a", "b"], "value_m": [np.float32(0.5), None], "hit": [True, False]}
    run.table("t", columns)
    assert pyarrow.parquet.read_table(run.path("t.parquet")).to_pydict() == {
        "name": ["a", "b"],
        "value_m": [0.5, None],
        "hit": [True, False],
    }
    assert run.path("t.csv").read_text().splitlines() == ["name,value_m,hit", "a,0.5,True", "b,,False"]
    with pytest.raises(ValueError, match="different lengths"):
        run.table("u", {"a": [1], "b": [1, 2]})


def test_summary_holds_numbers_or_null_only(tmp_path):
    run = runs.Run(tmp_path / "run", {})
    run.summary({"a_m": np.float32(1.5), "b": np.int32(2), "c_s": np.inf, "d_s": np.nan, "e": None, "f": True})
    assert read(run.path("summary.json")) == {"a_m": 1.5, "b": 2, "c_s": None, "d_s": None, "e": None, "f": 1}
    run.summary({"g": 2})
    assert read(run.path("summary.json")).keys() == {"a_m", "b", "c_s", "d_s", "e", "f", "g"}
