"""Compiled programs are kept for later runs, where nobody else can write them, and never break a run."""

import json
import os

import jax
import pytest

from urbanjax.io.runs import compile_cache
from urbanjax.types import FileError

PRIVATE = 0o700


def compiled(home, run, folder, **environment):
    """What a small run says in its manifest, and what it prints."""
    done = run("folder=compile", f"hydra.run.dir=outputs/{folder}", **environment)
    assert done.returncode == 0, done.stderr
    assert "answer: 42.0" in done.stdout
    assert done.stdout.splitlines()[-1] == f"run directory: outputs/{folder}"
    return json.loads((home / f"outputs/{folder}/manifest.json").read_text())["compiled"], done


def test_the_second_run_compiles_nothing(home, run, tmp_path):
    here = {"XDG_CACHE_HOME": str(tmp_path)}
    first, _ = compiled(home, run, "first", **here)
    second, done = compiled(home, run, "second", **here)
    assert first["from_folder"] == 0
    assert first["kept_anew"] == first["programs"] == second["from_folder"] > 0
    assert second["folder"] == str(tmp_path / "urbanjax" / "compiled" / compile_cache.key())
    assert f"compiled programs: {second['programs']} from {second['folder']}, 0 new" in done.stdout.splitlines()
    assert done.stderr == ""
    for folder in (tmp_path / "urbanjax", tmp_path / "urbanjax/compiled", *(tmp_path / "urbanjax/compiled").iterdir()):
        assert folder.stat().st_mode & 0o777 == PRIVATE


def test_a_file_that_cannot_be_read_is_compiled_anew_and_replaced(home, run, tmp_path):
    here = {"XDG_CACHE_HOME": str(tmp_path)}
    compiled(home, run, "whole", **here)
    folder = tmp_path / "urbanjax" / "compiled" / compile_cache.key()
    for path in folder.glob("*-cache"):
        path.write_bytes(path.read_bytes()[:-9])
    broken, done = compiled(home, run, "broken", **here)
    assert broken["unusable"] == broken["programs"]
    assert f", {broken['programs']} that could not be read" in done.stdout
    assert done.stderr == ""
    compiled(home, run, "mended", **here)
    assert compiled(home, run, "mended again", **here)[0]["from_folder"] == broken["programs"]


def test_what_another_process_is_writing_stays(tmp_path):
    for name, time in (("jit_old-1-cache", 1e9), ("jit_old-2-cache", 3e9), ("jit_other-1-cache", 1e9)):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (time, time))
    compile_cache._remove(tmp_path, ["jit_old"], 2e9)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["jit_old-2-cache", "jit_other-1-cache"]


def test_what_jax_is_told_holds(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "ours"))
    before = jax.config.jax_compilation_cache_dir, jax.config.jax_enable_compilation_cache
    try:
        jax.config.update("jax_enable_compilation_cache", True)
        jax.config.update("jax_compilation_cache_dir", str(tmp_path / "theirs"))
        assert compile_cache._on() == (tmp_path / "theirs", "")
        jax.config.update("jax_enable_compilation_cache", False)
        assert compile_cache._on() == (None, "JAX_ENABLE_COMPILATION_CACHE is false")
    finally:
        jax.config.update("jax_compilation_cache_dir", before[0])
        jax.config.update("jax_enable_compilation_cache", before[1])
    assert not (tmp_path / "ours").exists()


def test_without_a_place_to_write_to_a_run_does_without(home, run, tmp_path):
    (tmp_path / "file").touch()
    told, done = compiled(home, run, "nowhere", XDG_CACHE_HOME=str(tmp_path / "file"))
    assert told["folder"] is None
    assert done.stderr.startswith("note: compiled programs are not kept: ")
    assert done.stderr.count("\n") == 1


def test_no_home_is_made_for_it(tmp_path, monkeypatch):
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "nobody"))
    with pytest.raises(FileError, match="there is no home folder"):
        compile_cache._base()
    monkeypatch.setenv("HOME", str(tmp_path))
    assert compile_cache._base() == tmp_path / ".cache"
    monkeypatch.setenv("XDG_CACHE_HOME", "not/absolute")
    assert compile_cache._base() == tmp_path / ".cache"


@pytest.mark.parametrize("open_one", ["", "urbanjax", "urbanjax/compiled"], ids=["base", "ours", "below"])
@pytest.mark.parametrize("mode", [0o770, 0o707, 0o1777])
def test_a_folder_that_others_can_write_to_is_not_used(tmp_path, open_one, mode):
    compile_cache.folder_of(tmp_path)
    (tmp_path / open_one).chmod(mode)
    if mode == 0o1777 and not open_one:
        assert compile_cache.folder_of(tmp_path).is_dir()  # sticky: nobody moves what is ours
        return
    with pytest.raises(FileError, match=f"others can write to {tmp_path}|is not a folder of your own"):
        compile_cache.folder_of(tmp_path)


def test_a_folder_of_somebody_else_or_behind_a_link_is_not_used(tmp_path, monkeypatch):
    folder = compile_cache.folder_of(tmp_path / "one")
    monkeypatch.setattr(os, "geteuid", lambda: folder.stat().st_uid + 1)
    with pytest.raises(FileError, match="is not a folder of your own"):
        compile_cache.folder_of(tmp_path / "one")
    monkeypatch.undo()
    (tmp_path / "two").mkdir()
    (tmp_path / "two" / "urbanjax").symlink_to(tmp_path / "one" / "urbanjax")
    with pytest.raises(FileError, match="is not a folder of your own"):
        compile_cache.folder_of(tmp_path / "two")


def test_what_was_used_longest_ago_makes_room(tmp_path):
    (tmp_path / "key").mkdir()
    for age, name in enumerate(("new", "middle", "old")):
        path = tmp_path / "key" / name
        path.write_bytes(bytes(10))
        os.utime(path, (1e9 - age, 1e9 - age))
    os.utime(tmp_path / "key" / "old", (2e9, 1e9 - 9))  # written first, read last
    compile_cache.bound(tmp_path, 20)
    assert sorted(path.name for path in (tmp_path / "key").iterdir()) == ["new", "old"]
    compile_cache.bound(tmp_path, 20)
    assert len(list((tmp_path / "key").iterdir())) == 2


def test_nothing_of_a_compile_time_comes_from_elsewhere(home, run, tmp_path):
    here = {"XDG_CACHE_HOME": str(tmp_path / "ours")}
    told, done = compiled(home, run, "anew", TOY_ANEW="1", **here)
    assert told["folder"] is None
    assert "none kept (compile times are measured here)" in done.stdout
    assert not (tmp_path / "ours").exists()
