"""The candidate study: its grids and roads, agreement with Frenetix where that is installed, tables and figures."""

import numpy as np
import pytest
from PIL import Image

from experiments.candidates import figures as candidates_figures
from experiments.candidates import peer as candidates_peer
from experiments.candidates import study as candidates
from experiments.candidates.study import CandidateStudy
from urbanjax.types import ConfigError

SMALL = CandidateStudy(few=(2, 3, 4), many=(2, 3, 5), sweep=(4,), scenarios=2, repeats=1, batch_repeats=1)
NUMBERS = {
    "candidates_threads": 2.0,
    "candidates_80_first_call_s": 1.5,
    "candidates_80_handed_back_first_call_s": 1.6,
    "candidates_80_ms": 0.5,
    "candidates_80_handed_back_ms": 0.8,
    "frenetix_80_serial_ms": 6.0,
    "frenetix_80_concurrent_ms": 4.0,
    "candidates_80_times_faster": 8.0,
    "candidates_80_handed_back_times_faster": 5.0,
    "candidates_3x80_first_call_s": 2.0,
    "candidates_3x80_ms": 1.0,
    "stack_step_b1_ms": 9.0,
}


@pytest.mark.parametrize("durations", [1, 2, 3, 5, 7, 10, 20])
def test_durations_are_samples_up_to_the_horizon(durations):
    grid = candidates.grid((durations, 3, 4))
    steps = np.asarray(grid.durations) / grid.period
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert len(set(np.round(steps))) == durations
    assert 0 < steps.min() <= steps.max() == grid.n_times - 1
    assert (len(grid.speeds), len(grid.offsets)) == (3, 4)


@pytest.mark.parametrize("shape", [(0, 3, 4), (21, 3, 4), (5, 0, 4), (5, 3, 0)])
def test_grids_that_cannot_be_are_refused(shape):
    with pytest.raises(ConfigError, match="numbers of durations, speeds and offsets, not \\[1, 2\\]"):
        candidates.grid((1, 2))
    with pytest.raises(ConfigError, match="use 1 to 20 durations"):
        candidates.grid(shape)


def test_roads_are_the_same_on_both_sides_and_differ_between_scenarios():
    rng = np.random.default_rng(0)
    for road in (candidates.road(), candidates.road(rng), candidates.road(rng)):
        rows = np.asarray(road.line.rows)
        np.testing.assert_allclose(rows[:, :2], road.path[::5], atol=1e-4)
        middle = (rows[1:] + rows[:-1]) / 2
        np.testing.assert_allclose(np.diff(rows[:, 2]), 0.5 * middle[:, 3], atol=1e-5)
        direction = np.diff(rows[:, :2], axis=0) / 0.5
        np.testing.assert_allclose(np.unwrap(np.arctan2(*direction.T[::-1])), middle[:, 2], atol=1e-4)
    assert not np.allclose(rows, np.asarray(candidates.road(rng).line.rows))


@pytest.mark.slow
def test_ours_alone(monkeypatch):
    monkeypatch.setattr(candidates_peer, "library", lambda: None)
    numbers = candidates.measure(SMALL)
    assert not any(name.startswith(("agreement", "frenetix")) for name in numbers)
    rows = candidates.times_table(numbers)
    assert rows["candidates"] == ["24", "30", "2 scenarios x 24"]
    assert min(rows["ours [ms]"]) > 0
    assert rows["Frenetix [ms]"] == rows["faster"] == [None] * 3


def test_tables_pair_our_times_with_the_better_of_theirs():
    rows = candidates.times_table(NUMBERS)
    assert rows["candidates"] == ["80", "3 scenarios x 80"]
    assert rows["ours [ms]"] == [0.5, 1.0]
    assert rows["Frenetix [ms]"] == [4.0, None]
    assert rows["faster"] == [8.0, None]
    assert rows["compile [s]"] == [1.5, 2.0]
    agreement = {"agreement_few_candidates": 80.0, "agreement_few_x_m": 1e-4, "agreement_slow_x_m": 2e-4}
    table = candidates.agreement_table(agreement)
    assert table["largest difference"] == ["x_m"]
    assert table["80 candidates"] == [1e-4]


def test_figures_are_drawn(tmp_path):
    candidates_figures.draw_fan(SMALL, tmp_path / "fan.png")
    candidates_figures.draw_times(NUMBERS, tmp_path / "times.png")
    for name in ("fan.png", "times.png"):
        with Image.open(tmp_path / name) as image:
            assert np.asarray(image.convert("L")).std() > 5.0
