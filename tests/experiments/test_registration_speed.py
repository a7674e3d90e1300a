"""The registration benchmark times what it says, and its table pairs our times with the peer's."""

import numpy as np
import pytest

from experiments.common import registration_speed
from experiments.common.registration_speed import RegistrationStudy


@pytest.mark.slow
def test_ours_alone(monkeypatch):
    monkeypatch.setattr(registration_speed, "peer_of", lambda *_: None)
    numbers = registration_speed.measure(RegistrationStudy(points=3000, starts=2, repeats=1))
    assert numbers["registration_dropped_voxels"] == 0
    assert numbers["registration_error_m"] < 0.05
    rows = registration_speed.table(numbers)
    assert rows["registration (median, warm)"] == ["preprocess", "map", "align", "align_2_starts"]
    assert rows["small_gicp [ms]"] == rows["ratio"] == [None] * 4
    assert min(rows["ours [ms]"]) > 0


def test_ratios_are_ours_over_theirs():
    rows = registration_speed.table({"registration_align_ms": 1.0, "small_gicp_align_ms": 4.0, "stack_step_b1_ms": 9.0})
    assert rows["registration (median, warm)"] == ["align"]
    assert rows["ratio"] == [0.25]


def test_the_street_is_the_same_for_the_same_seed_and_of_the_size_asked_for():
    a, b = registration_speed.street(500, 3), registration_speed.street(500, 3)
    np.testing.assert_array_equal(a, b)
    assert a.shape == (500, 3)
    assert np.abs(a[:, 1]).max() == pytest.approx(11, abs=0.1)
