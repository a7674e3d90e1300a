"""Values of a sweep: what a text stands for, what is crossed, what is sampled together."""

import itertools

import numpy as np
import pytest
from scipy.stats import qmc

from urbanjax.io.runs.sweeps.axes import MOST, axes_of, jobs_of
from urbanjax.types import ConfigError


def values(text, **others):
    (axis,) = axes_of({"a": [text], **others})
    return axis.values


def test_a_grid_holds_both_ends_and_is_even():
    assert values("linspace:0:1:5") == (0.0, 0.25, 0.5, 0.75, 1.0)
    assert values("linspace:-2:2:2") == (-2.0, 2.0)
    assert values("linspace:3:3:1") == (3.0,)
    np.testing.assert_allclose(values("logspace:0.01:100:5"), [0.01, 0.1, 1, 10, 100], rtol=1e-12)


def test_other_values_are_left_as_they_are():
    (axis,) = axes_of({"a": [1, "cut_in", [1.0, 2.0], "linspace", True, "sobol"]})
    assert axis.kind == "choice"
    assert axis.values == (1, "cut_in", [1.0, 2.0], "linspace", True, "sobol")
    (axis,) = axes_of({"a": [7, "linspace:0:1:2"]})
    assert axis.values == (7, 0.0, 1.0)


def test_grids_are_crossed_with_the_last_key_fastest():
    axes = axes_of({"a": ["linspace:0:1:3"], "b": [1, 2], "c": ["x", "y"]})
    expected = [dict(zip("abc", row, strict=True)) for row in itertools.product((0.0, 0.5, 1.0), (1, 2), "xy")]
    assert jobs_of(axes) == expected


def test_nothing_swept_is_one_job():
    assert jobs_of(axes_of({})) == [{}]


@pytest.mark.parametrize("kind", ["sobol", "lhs"])
def test_samples_of_one_kind_are_drawn_together_and_crossed_with_the_rest(kind):
    axes = axes_of({"a": [f"{kind}:0:2:16"], "c": ["x", "y"], "b": [f"{kind}:0.1:10:16:log"]}, seed=3)
    jobs = jobs_of(axes)
    assert len(jobs) == 32
    assert list(jobs[0]) == ["a", "c", "b"]
    points = np.array([[job["a"], job["b"]] for job in jobs if job["c"] == "x"])
    assert len(points) == 16
    unit = np.column_stack([points[:, 0] / 2, np.log(points[:, 1] / 0.1) / np.log(100)])
    assert np.all((unit >= 0) & (unit <= 1))
    for column in unit.T:  # one point in each of sixteen intervals: of both kinds, of any other draw hardly ever
        assert sorted((column * 16).astype(int)) == list(range(16))
    assert qmc.discrepancy(unit) < qmc.discrepancy(np.random.default_rng(0).random((16, 2)))
    assert abs(np.corrcoef(unit.T)[0, 1]) < 0.5
    assert [axis.log for axis in axes] == [False, False, True]


def test_a_sample_depends_on_its_seed_alone():
    asked = {"a": ["sobol:0:1:12"], "b": ["lhs:0:1:5"]}
    assert axes_of(asked, seed=1) == axes_of(asked, seed=1)
    assert axes_of(asked, seed=1)[0].values != axes_of(asked, seed=2)[0].values
    assert axes_of(asked, seed=1)[1].values != axes_of(asked, seed=2)[1].values
    assert len(jobs_of(axes_of(asked, seed=1))) == 60


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"a": ["linspace:0:1"]}, "a=linspace:0:1: write KIND:LOW:HIGH:N"),
        ({"a": ["linspace:0:x:3"]}, "write KIND"),
        ({"a": ["linspace:0:1:2.5"]}, "write KIND"),
        ({"a": ["linspace:0:1:0"]}, "write KIND"),
        ({"a": ["linspace:0:inf:3"]}, "write KIND"),
        ({"a": ["linspace:0:1:3:log"]}, "write KIND"),
        ({"a": ["sobol:0:1:3:lin"]}, "write KIND"),
        ({"a": ["linspace:1:0:3"]}, "1 is not below 0"),
        ({"a": ["logspace:0:1:3"]}, "ends above 0"),
        ({"a": ["sobol:-1:1:3:log"]}, "ends above 0"),
        ({"a": ["sobol:0:1:8"], "b": ["sobol:0:1:4"]}, r"one length \(a has 8, b has 4\)"),
        ({"a": ["sobol:0:1:8", 2]}, "a sample stands alone"),
        ({"a": []}, "'a' has no values"),
        ({"a": ["linspace:0:1:2000"], "b": ["linspace:0:1:2000"]}, f"4000000 jobs, more than {MOST}"),
    ],
)
def test_what_is_nearly_right_is_told(asked, message):
    with pytest.raises(ConfigError, match=message):
        jobs_of(axes_of(asked))
