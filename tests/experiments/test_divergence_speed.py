"""The benchmark of the divergence: equal results first, the same numbers for both kinds of points, table and figure."""

import numpy as np
import pytest
from PIL import Image

from experiments.benchmark import divergence_points, divergence_speed
from experiments.benchmark import figures as divergence_speed_figure
from experiments.benchmark.divergence_speed import DivergenceSpeedStudy
from urbanjax.types import ConfigError

NUMBERS = {
    "divergence_2000_bytes_per_point": 130.0,
    "divergence_3x500_bytes_per_point": 900.0,
    "divergence_gaussian_2000_ms": 2.0,
    "ckdtree_gaussian_2000_ms": 6.0,
    "ckdtree_unbalanced_gaussian_2000_ms": 5.0,
    "package_gaussian_2000_ms": 9.0,
    "ckdtree_gaussian_2000_difference_nats": 1e-7,
    "ckdtree_unbalanced_gaussian_2000_difference_nats": 1e-7,
    "package_gaussian_2000_difference_nats": 3e-7,
    "divergence_gaussian_2000_times_faster": 2.5,
    "divergence_gaussian_2000_first_nats": 0.6,
    "divergence_gaussian_3x500_ms": 4.0,
    "ckdtree_gaussian_3x500_ms": 8.0,
    "ckdtree_gaussian_3x500_difference_nats": 2e-7,
    "divergence_gaussian_3x500_times_faster": 2.0,
    "divergence_gaussian_3x500_first_nats": 0.2,
    "candidates_80_times_faster": 8.0,
    "stack_step_b1_ms": 9.0,
}


class Package:
    """An answer a millinat off."""

    @staticmethod
    def knn_kl_divergence(x, y, *, k):
        return divergence_speed.by_trees(np.stack([x, y]), ((0, 1),), k, 1)[0] + 1e-3


@pytest.fixture(scope="module")
def numbers():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(divergence_speed, "package", lambda: Package)
        return divergence_speed.measure(
            DivergenceSpeedStudy(sizes=(300,), teams=3, each=300, package_most=300, repeats=2)
        )


def test_all_find_the_same_and_a_peer_that_does_not_is_seen(numbers):
    for kind in divergence_points.KINDS:
        for name in (f"{kind}_300", f"{kind}_3x300"):
            assert numbers[f"ckdtree_{name}_difference_nats"] < 1e-5
            assert numbers[f"ckdtree_unbalanced_{name}_difference_nats"] < 1e-5
            better = min(numbers[f"{tree}_{name}_ms"] for tree in ("ckdtree", "ckdtree_unbalanced"))
            assert numbers[f"divergence_{name}_times_faster"] == pytest.approx(
                better / numbers[f"divergence_{name}_ms"]
            )
        assert numbers[f"package_{kind}_300_difference_nats"] == pytest.approx(1e-3, abs=1e-5)
        assert f"package_{kind}_3x300_ms" not in numbers
    assert numbers["divergence_gaussian_300_first_nats"] == pytest.approx(0.64, abs=0.25)
    assert numbers["divergence_300_bytes_per_point"] > 8


def test_a_call_too_long_to_repeat_is_timed_once(monkeypatch):
    calls = []
    times, results = divergence_speed._in_turns({"ours": lambda: calls.append("ours") or 3.0}, 1)
    assert calls == ["ours"]
    assert times["ours"] > 0
    assert results["ours"] == 3
    divergence_speed._in_turns({"a": lambda: calls.append("a"), "b": lambda: calls.append("b")}, 2)
    assert calls[1:] == ["a", "b"] * 3


def test_table_pairs_ours_with_the_better_tree():
    rows = divergence_speed.table(NUMBERS)
    assert rows["points"] == ["gaussian 2000", "gaussian 3 teams x 500"]
    assert rows["ours [ms]"] == [2.0, 4.0]
    assert rows["cKDTree [ms]"] == [5.0, 8.0]
    assert rows["faster"] == [2.5, 2.0]
    assert rows["package [ms]"] == [9.0, None]
    assert rows["apart [nats]"] == [3e-7, 2e-7]
    assert rows["bytes/point"] == [130.0, 900.0]


def test_laps_lie_evenly_along_a_closed_curve_of_5_km():
    a, b = (divergence_points.course(2, 9000, np.random.default_rng(seed)).astype(float) for seed in (3, 3))
    np.testing.assert_array_equal(a, b)
    laps = a.reshape(2, 9, 1000, 2)
    steps = np.linalg.norm(np.diff(laps, axis=2), axis=-1)
    assert steps.sum(axis=-1) == pytest.approx(5000, rel=0.02)
    assert 1 < steps.min() < steps.max() < 10
    aside = np.linalg.norm(laps[:, 1:] - laps[:, :-1], axis=-1)
    assert 0.5 < np.median(aside) < 4
    assert np.linalg.norm(laps[:, :, -1] - laps[:, :, 0], axis=-1).max() < 15


def test_teams_in_the_cloud_spread_from_1_to_2():
    points = divergence_points.gaussian(3, 20_000, np.random.default_rng(0))
    np.testing.assert_allclose(points.std(axis=1), np.array([[1.0], [1.5], [2.0]]) * np.ones((3, 2)), rtol=0.02)


def test_teams_without_enough_neighbours_are_refused():
    with pytest.raises(ConfigError, match=r"'sizes' \(1000, 6\) must exceed k \+ 1"):
        divergence_speed.measure(DivergenceSpeedStudy(sizes=(1000, 6)))


def test_figure_is_drawn_whatever_was_measured(numbers, tmp_path):
    few = {key: value for key, value in numbers.items() if "package" not in key and "bytes" not in key}
    for name, found in (("all", numbers), ("few", few)):
        divergence_speed_figure.draw(found, tmp_path / f"{name}.png")
        with Image.open(tmp_path / f"{name}.png") as image:
            assert np.asarray(image.convert("L")).std() > 5.0
