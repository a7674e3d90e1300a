"""One command draws any map and says what looks wrong in it."""

import json
import subprocess
import sys

import pytest

from tests.conftest import REPOSITORY
from tests.io.maps import texts


def run(tmp_path, *arguments):
    command = [sys.executable, "-m", "experiments.map", *arguments]
    return subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=_environment(), timeout=120)


def _environment():
    import os

    return {**os.environ, "PYTHONPATH": str(REPOSITORY)}


@pytest.mark.parametrize("name", ["commonroad", "sumo"])
def test_a_map_ends_in_a_picture_and_a_report(tmp_path, name):
    (tmp_path / "map.xml").write_text({"commonroad": texts.COMMONROAD, "sumo": texts.SUMO}[name])
    done = run(tmp_path, "file=map.xml", "hydra.run.dir=out")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "run directory: out"
    assert (tmp_path / "out" / "map.png").stat().st_size > 10_000
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["links"] == {"commonroad": 5, "sumo": 7}[name]
    assert "links: " in done.stdout


def test_a_mistake_is_one_line(tmp_path):
    (tmp_path / "map.xml").write_text("<net/>")
    for arguments, message in (((), "file is empty"), (("file=map.xml",), "holds no lane")):
        done = run(tmp_path, *arguments)
        assert done.returncode == 2
        assert message in done.stderr
        assert len(done.stderr.strip().splitlines()) == 1
