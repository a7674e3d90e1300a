"""Tuning from scenes to a tested parameter file, at a size that compiles quickly."""

import dataclasses

import numpy as np
import pytest

from experiments.tune import closed_loop, search
from experiments.tune.study import HeldBackParams, TuneStudy
from tests.scenes import loop_params
from urbanjax.io.runs.checkpoints import read_checkpoint, write_checkpoint
from urbanjax.io.runs.directory import Run
from urbanjax.io.runs.parameter_file import read_parameters
from urbanjax.tuning import SceneParams, TrainingParams
from urbanjax.types import ConfigError, FileError

LOOP = loop_params()
STUDY = TuneStudy(
    stack=LOOP.stack,
    sim=LOOP.sim,
    tuned=("stack.behavior.gvp.tau", "stack.planning.micro.weights.macro"),
    learned=SceneParams(missions=("overtake", "cut_in"), count=6, latest=3.0),
    judged=SceneParams(missions=("overtake",), roads=(12, 13), count=4, latest=3.0),
    tested=HeldBackParams(missions=("cut_in",), traffic=("idm",), seeds=2),
    training=TrainingParams(generations=3, scenes=4, horizons=(1.0,), every=2),
)


def run_in(folder, **changes):
    study = dataclasses.replace(STUDY, **changes)
    return study, Run(folder, {"task": study.task, "resume": study.resume})


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    study, run = run_in(tmp_path_factory.mktemp("tune") / "whole")
    closed_loop.write(study, run)
    return run


def test_what_is_asked_is_written(whole):
    for name in ("convergence", "values", "differences", "before_after"):
        assert whole.path(f"{name}.png").stat().st_size > 10_000, name
    values = read_parameters(whole.path("tuned.yaml"))
    assert set(values) == set(STUDY.tuned)
    card = whole.path("card.md").read_text()
    assert "2 whole drives of cut_in among idm" in card
    assert "at-fault collision" in card
    assert whole.path("report.html").stat().st_size > 100_000


def test_a_killed_search_resumes_bit_for_bit(whole, tmp_path, monkeypatch):
    study, run = run_in(tmp_path / "cut")
    written = []

    def killed(path, arrays, *, about):
        write_checkpoint(path, arrays, about=about)
        written.append(path)
        if len(written) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(search, "write_checkpoint", killed)
    with pytest.raises(KeyboardInterrupt):
        search.searched(study, run)
    monkeypatch.undo()
    study, again = run_in(tmp_path / "again", resume=str(run.directory))
    search.searched(study, again)
    ours, theirs = (read_checkpoint(one.path(search.CHECKPOINT))[0] for one in (again, whole))
    assert set(ours) == set(theirs)
    for name, value in theirs.items():
        np.testing.assert_array_equal(ours[name], value, err_msg=name)


def test_what_cannot_be_resumed_is_said(whole, tmp_path):
    study, run = run_in(tmp_path / "none", resume=str(tmp_path))
    with pytest.raises(ConfigError, match=r"there is no checkpoint\.safetensors"):
        search.searched(study, run)
    study, run = run_in(tmp_path / "other", resume=str(whole.directory))
    run.resolved = {"task": "another"}
    with pytest.raises(ConfigError, match="of another config"):
        search.searched(study, run)
    cut = tmp_path / search.CHECKPOINT
    cut.write_bytes(whole.path(search.CHECKPOINT).read_bytes()[:40])
    study, run = run_in(tmp_path / "broken", resume=str(tmp_path))
    with pytest.raises(FileError, match=r"checkpoint\.safetensors"):
        search.searched(study, run)
