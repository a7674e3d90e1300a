"""What a config takes from the environment is used, and stands nowhere in what is written."""

import json

import pytest

from urbanjax.io.runs import directory, interpolation
from urbanjax.types import ConfigError

TEXT = "${oc.env:SECRET_DIR}"
PRESET = (
    "# @package _global_\nseed: ${oc.decode:${oc.env:SEED}}\nfolder: ${oc.env:SECRET_DIR}\n"
    "vehicle:\n  length: ${vehicle.width}\n"
)


@pytest.fixture
def drive(home, run):
    """A run of the preset above in an environment: what it came to, its manifest, and all that it wrote as text."""
    (home / "outside/preset").mkdir(parents=True, exist_ok=True)
    (home / "outside/preset/from_outside.yaml").write_text(PRESET)

    def drive_in(**environment):
        name = f"outputs/from_outside_{'_'.join(environment.values()).replace('/', '_')}"
        done = run("--config-dir=outside", "preset=from_outside", f"hydra.run.dir={name}", **environment)
        files = [path.read_bytes() for path in (home / name).rglob("*") if path.is_file()]
        return done, json.loads((home / name / "manifest.json").read_text()), b"".join(files)

    return drive_in


def test_the_value_is_used_and_its_text_is_written(drive):
    done, manifest, written = drive(SEED="7351", SECRET_DIR="hush/hush")
    assert done.returncode == 0, done.stderr
    assert manifest["config"]["folder"] == TEXT
    assert manifest["config"]["seed"] == manifest["seed"] == "${oc.decode:${oc.env:SEED}}"
    assert manifest["config"]["vehicle"]["length"] == "${vehicle.width}"
    for value in (b"7351", b"hush/hush"):
        assert value not in written.replace(manifest["config_sha256"].encode(), b"").replace(b"from_outside_7351", b"")


def test_the_hash_is_that_of_the_values(drive):
    first, second = (drive(SEED=seed, SECRET_DIR="a")[1] for seed in ("1", "2"))
    assert first["config"] == second["config"]
    assert first["config_sha256"] != second["config_sha256"]


def test_an_error_in_the_manifest_does_not_tell_the_value(drive):
    done, manifest, written = drive(SEED="1", SECRET_DIR="/secret/place")
    assert done.stderr == "error: /secret/place/x is not there\n"
    assert manifest["error"] == f"ScenarioError: {TEXT}/x is not there"
    assert b"/secret/place" not in written


def test_a_manifest_is_read_with_the_values_of_now(monkeypatch):
    written = {"a": {"b": "${oc.env:PLACE}", "c": 1}, "d": ["${a.c}"]}
    monkeypatch.setenv("PLACE", "here")
    assert interpolation.resolved(written) == {"a": {"b": "here", "c": 1}, "d": [1]}
    monkeypatch.delenv("PLACE")
    with pytest.raises(ConfigError, match=r"'a\.b': the environment has no PLACE; set it"):
        interpolation.resolved(written)


def test_a_text_hides_values_of_any_depth():
    written = {"a": [{"b": TEXT}], "c": "plain", "d": "${c}"}
    resolved = {"a": [{"b": "/home/me"}], "c": "plain", "d": "abc"}
    found = interpolation.hidden("no /home/me/file in plain abc", written, resolved=resolved)
    assert found == f"no {TEXT}/file in plain abc"


def test_a_run_without_interpolations_is_written_as_it_is(tmp_path):
    run = directory.Run(tmp_path, {"x": 1})
    assert run.config == run.resolved == {"x": 1}
    assert run.manifest()["config_sha256"] == directory.digest({"x": 1})
