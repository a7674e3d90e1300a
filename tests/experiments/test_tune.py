"""Tuning from scenes to a tested parameter file, at a size that compiles quickly."""

import dataclasses
import json

import jax.numpy as jnp
import numpy as np
import pytest

from experiments.tune import budget, closed_loop, horizons, pareto, search
from experiments.tune.study import BudgetParams, HeldBackParams, HorizonsParams, ParetoParams, TuneStudy
from tests.scenes import loop_params
from urbanjax.io.runs.checkpoints import read_checkpoint, write_checkpoint
from urbanjax.io.runs.directory import Run
from urbanjax.io.runs.networks import load_learned
from urbanjax.io.runs.parameter_file import read_parameters
from urbanjax.planning.learned import CONTEXT
from urbanjax.planning.micro import MICRO_TERMS
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


def test_a_network_begins_with_nothing():
    base = search.begun(dataclasses.replace(STUDY, network=True))
    learned = base.stack.planning.micro.learned
    features = jnp.ones((3, len(MICRO_TERMS))) * jnp.arange(3.0)[:, None]
    np.testing.assert_array_equal(learned(features, jnp.ones(len(CONTEXT))), np.zeros(3))
    assert search.begun(STUDY).stack.planning.micro.learned is None


@pytest.mark.slow
def test_a_network_is_tuned_and_kept(tmp_path):
    training = dataclasses.replace(STUDY.training, generations=2)
    study, run = run_in(tmp_path / "network", network=True, training=training)
    closed_loop.write(study, run)
    before, after = search.begun(study).stack.planning.micro.learned, load_learned(run.path("network.safetensors"))
    assert np.abs(after.kernel[-1] - before.kernel[-1]).max() > 0
    np.testing.assert_array_equal(after.size, before.size)
    assert set(read_parameters(run.path("tuned.yaml"))) == set(STUDY.tuned)
    assert "only half of it" in run.path("tuned.yaml").read_text()
    assert "the layers of a learned cost" in run.path("card.md").read_text()


def summary_of(run):
    return json.loads(run.path("summary.json").read_text())


@pytest.mark.slow
def test_a_front_is_one_run(whole, tmp_path):
    study, run = run_in(tmp_path / "front", task="pareto", pareto=ParetoParams(points=2, taus=(0.0,)))
    pareto.write(study, run)
    found = summary_of(run)
    assert 1 <= found["front_points"] <= 2
    assert found["before_at_fault_percent"] == 0
    assert len(list(run.directory.glob("comfort_*.yaml"))) == 2
    assert run.path("report.html").exists()


@pytest.mark.slow
def test_searches_at_equal_cost_resume_where_they_were_cut(whole, tmp_path):
    asked = BudgetParams(optimisers=("gradient", "random"), evaluations=20.0, apart=10.0, restarts=1)
    study, run = run_in(tmp_path / "budget", task="budget", budget=asked)
    budget.write(study, run)
    found = summary_of(run)
    assert found["cost_of_gradient"] > 1
    (run.path(budget.FOLDER) / "random-0.safetensors").unlink()
    study, again = run_in(tmp_path / "again", task="budget", budget=asked, resume=str(run.directory))
    budget.write(study, again)
    for name in ("gradient_last_score", "random_last_score"):
        assert summary_of(again)[name] == found[name]


@pytest.mark.slow
def test_gradients_are_small_differences_in_double_precision(tmp_path):
    asked = HorizonsParams(weights=STUDY.tuned, seconds=(1.0, 2.0), temperatures=(0.3,), scenes=2)
    study, run = run_in(tmp_path / "horizons", task="horizons", horizons=asked)
    horizons.write(study, run)
    assert summary_of(run)["horizon_1_s_temperature_0.3_error_greatest"] < 1e-5
