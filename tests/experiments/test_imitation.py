"""Planted drivers are recovered; predictions are counted as they should be; without the data one line says so."""

import numpy as np
import pytest

from experiments.tune.imitation import paths, recovery, tables
from experiments.tune.imitation.paths import PathStudy
from experiments.tune.imitation.predictors import CONSTANT, LINEAR, NETWORK, WIDER, Predictions, Study
from experiments.tune.imitation.task import ImitationTask, RecordedDrivers, chosen_from, drivers
from tests import scenes
from urbanjax.planning.micro import MICRO_TERMS
from urbanjax.types import ConfigError

TASK = ImitationTask(planted=240, steps=250)


@pytest.fixture(scope="module")
def loop():
    return scenes.loop_params()


@pytest.fixture(scope="module")
def planted(loop):
    return recovery.demonstrated(loop, recovery.situations(loop, TASK))


def test_planted_weights_of_candidates_are_recovered(loop, planted):
    found = recovery.of_candidates(TASK, loop, chosen_from(loop, planted))
    assert found.cosine >= 0.99
    assert found.regret <= 0.01
    assert set(found.uninformed) == {"transition"} < set(MICRO_TERMS)


def test_planted_weights_of_the_lattice_are_recovered(loop, planted):
    found = recovery.of_paths(TASK, loop, paths.driven_paths(loop, planted))
    assert found.cosine >= 0.99
    assert found.regret <= 0.01


def test_without_the_data_one_line_says_so(loop, tmp_path):
    with pytest.raises(ConfigError, match="there is no C-DEU"):
        drivers(TASK.replace(folder=str(tmp_path)), loop, print)


def test_means_are_over_moments_and_intervals_over_drivers():
    error = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 9.0]])
    nothing = np.full(3, np.nan)
    found = Predictions(error, np.arange(3.0), nothing, np.zeros(3, int))
    who = RecordedDrivers(np.array(["a", "a", "b"]), np.array(["a 1", "a 1", "b 1"]), None, {})
    measured = tables.measured(found, who)
    assert measured["fde_m"].value == 5.0
    assert measured["ade_m"].value == 4.0
    assert measured["log_density_nat"].value == 1.0
    assert np.isnan(measured["log_share_nat"].value)
    assert (measured["fde_m"].low, measured["fde_m"].high) == (3.0, 9.0)


@pytest.mark.parametrize(
    ("constant", "told"),
    [
        (1.0, "predicts better than 'tuned linear'"),
        (3.0, "predicts neither clearly better nor worse"),
        (4.0, "worse than 'tuned linear'"),
    ],
)
def test_the_caption_says_so_where_constant_velocity_predicts_better(constant, told):
    nothing, chosen = np.full(4, np.nan), np.zeros(4, int)
    error = {name: np.full((4, 2), 3.0) for name in (WIDER, LINEAR, NETWORK)} | {CONSTANT: np.full((4, 2), constant)}
    found = {name: Predictions(values, nothing, nothing, chosen) for name, values in error.items()}
    who = RecordedDrivers(np.array(list("aabb")), np.array(["a 1", "a 2", "b 1", "b 2"]), None, {})
    study = Study(found, {}, {}, {}, {})
    assert told in tables.verdict(study, who)
    rows = tables.paired_rows(study, who)
    assert rows["FDE at 3 s"][0] == f"{LINEAR} - {WIDER}"  # of one fan
    assert rows["difference [m]"][-1].startswith(f"{constant - 3:.2f}")


def test_the_caption_says_which_file_tuning_fails_on():
    who = RecordedDrivers(np.array(list("aabb")), np.array(["a 1", "a 2", "b 1", "b 2"]), None, {})
    tuned = np.array([1.0, 1.5, -2.0, -2.5])
    study = PathStudy(np.ones(4, bool), np.full(4, 3), np.zeros(4), tuned, {}, {}, {})
    told = tables.verdict_of_paths(study, who)
    assert "likelier in 1 of 2 files" in told
    assert "less likely in b (-2.25" in told
