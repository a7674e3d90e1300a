"""The registration study: what counts as success, how s^2 is fitted, and how its tables and grids are laid out."""

import dataclasses
import types

import jax.numpy as jnp
import jaxlie
import numpy as np
import pytest
import yaml
from scipy import stats

from experiments.common.lost import lost_after
from experiments.register import calibration, factorial, figures, pair, rows, stretch
from experiments.register.bench import Bench, BenchPrograms, Found, Seen
from experiments.register.calibration import Calibration, Errors
from experiments.register.factorial import FactorialParams, Grid
from experiments.register.pair import PairParams
from experiments.register.rows import PAPER, STARTS, RowTrack
from experiments.register.study import RegisterStudy
from tests.conftest import REPOSITORY
from urbanjax.types import ConfigError, config


@pytest.mark.parametrize(
    ("distance", "after"),
    [([0.1, 0.2, 0.3], None), ([0.1, 0.6, 0.2], None), ([0.1, 0.6, 0.7], 1), ([0.6, 0.7], 0), ([0.5], None)],
)
def test_a_pose_is_lost_from_the_scan_after_which_it_never_comes_back(distance, after):
    assert lost_after(np.array(distance), 0.5) == after


def test_outcomes_tell_loss_and_slowness_apart():
    fast, slow = np.full((3, 3), 30.0), np.array([[10.0, 10.0, 10.0], [50.0, 50.0, 1.0], [90.0, 10.0, 1.0]])
    well, lost = np.full(3, 0.01), np.array([0.1, 0.6, 3.0])
    assert rows.outcome(well, fast, 0.5, 0.1) == (False, False)
    assert rows.outcome(well, slow, 0.5, 0.1) == (False, True)
    assert rows.outcome(lost, fast, 0.5, 0.1) == (True, False)
    assert [rows.verdict(*x) for x in ((False, False), (True, False), (True, True))] == [
        "success",
        "fail (lost)",
        "fail (lost, slow)",
    ]


def test_the_rows_are_those_of_the_paper():
    printed = [
        (r.channels, r.sensing, r.voxel, r.threshold, r.iterations, r.epsilon, r.threads, r.reach) for r in PAPER
    ]
    assert printed[:4] == [
        (128, 70, 0.5, 0.2, 32, 0.01, None, None),
        (64, 70, 0.5, 0.2, 64, 0.01, None, None),
        (64, 100, 0.5, 0.2, 128, 0.01, None, None),
        (64, 80, 0.5, 0.2, 64, 0.03, None, None),
    ]
    assert printed[4:] == [(96, 100, 1.0, 0.5, None, None, n, 1.0) for n in (2, 10, 6)] + [
        (128, 100, 1.0, 0.5, None, None, 6, 3.0)
    ]
    assert [r.outcome for r in PAPER] == ["fail"] * 3 + ["success"] + ["fail"] * 3 + ["success"]
    assert len({r.setting for r in PAPER}) == 6  # rows 5 to 7 differ in threads only


def _tracks(lost: bool) -> dict:
    error = np.array([[0.1, 0.0, 0.0], [3.0 if lost else 0.2, 4.0 if lost else 0.0, 0.0]])
    track = RowTrack(error, np.array([0.1, 0.6]), np.ones(2), np.array([4.0, 6.0]), np.full((2, 3), 20.0), 0, 5)
    return {(row.setting, start): track for row in PAPER for start in STARTS}


def test_table_1_has_the_paper_beside_ours_for_both_starts():
    found = rows.table(_tracks(lost=True), np.array([10.0, 11.0, 12.0]), 0.5, 0.1)
    assert found["row"] == [k for k in range(1, 9) for _ in STARTS]
    assert found["start"] == list(STARTS.values()) * 8
    assert set(found["ours"]) == {"fail (lost)"}
    assert found["lost after [s]"][0] == pytest.approx(0.1)
    assert found["lost at [km/h]"][0] == pytest.approx(43.2)
    assert found["mean error [m]"][0] == pytest.approx(0.1)  # before the loss
    assert found["largest [m]"][0] == pytest.approx(5.0)
    assert found["above threshold [%]"][0] == 0
    flat = rows.summary(found)
    assert flat["rows_as_in_the_paper_odometry"] == 6
    kept = rows.table(_tracks(lost=False), np.array([10.0, 11.0, 12.0]), 0.5, 0.1)
    assert set(kept["ours"]) == {"success"}
    assert kept["above threshold [%]"][0] == 50
    assert kept["scan [ms]"][0] == pytest.approx(60.0)


def _errors(n: int, scale: float, seed: int) -> Errors:
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(n, 3, 3))
    covariance = half @ half.transpose(0, 2, 1) + 0.1 * np.eye(3)
    drawn = np.einsum("nij,nj->ni", np.linalg.cholesky(scale * covariance), rng.normal(size=(n, 3)))
    return Errors(drawn, covariance, np.arange(n) % 10 > 0)


def test_the_scale_of_a_covariance_is_found_again():
    assert calibration.fitted_scale(7.0 * stats.chi2.rvs(3, size=40_000, random_state=0), 0.95) == pytest.approx(
        7, rel=0.03
    )
    fit, test = _errors(3000, 7.0, 1), _errors(2000, 7.0, 2)
    found = Calibration(calibration.fitted_scale(fit.nees, 0.95), 0.95, fit, test)
    assert len(test.nees) == 1800  # of those that converged
    assert found.scale == pytest.approx(7, rel=0.1)
    assert found.coverage() == pytest.approx(0.95, abs=0.02)
    assert found.coverage(0.5) == pytest.approx(0.5, abs=0.04)
    assert found.coverage(scale=1.0) < 0.5
    np.testing.assert_allclose(found.factors, np.sqrt(7.0), rtol=0.05)
    assert calibration.summary(found)["calibration_not_converged"] == 500
    assert len(calibration.table(found)["set"]) == 5000


def test_starts_are_where_the_vehicle_was_one_scan_before():
    speed, offset = factorial.starts(FactorialParams(position_noise=0.0), 50, 0.1, 3)
    np.testing.assert_allclose(offset[:, 0], -0.1 * speed, rtol=1e-6)
    np.testing.assert_allclose(offset[:, 1], 0.0)
    np.testing.assert_allclose(np.sort(speed), 60 / 3.6 * (np.arange(50) + 0.5) / 50, rtol=1e-6)
    assert 0.01 < offset[:, 2].std() < 0.03


def test_a_threshold_is_judged_by_what_it_finds_and_refuses():
    error, wrong = np.array([0.1, 0.3, 0.3, 0.6]), np.array([False, False, True, True])
    assert factorial.alarms(error, wrong, 0.2) == (100.0, 50.0)
    assert factorial.alarms(error, wrong, 0.5) == (50.0, 0.0)
    assert factorial.alarms(error, wrong | True, 0.2) == (75.0, None)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"channels": (64, 129)}, "128 rings"),
        ({"voxel": (0.0,)}, "voxel is 0.0"),
        ({"iterations": (32, 10)}, "must rise"),
    ],
)
def test_grids_that_cannot_be_run_are_refused(changes, said):
    with pytest.raises(ConfigError, match=said):
        factorial.checked(dataclasses.replace(FactorialParams(), **changes))
    factorial.checked(FactorialParams())


class _Stub(Bench):
    """Registrations that need as many iterations as the voxel says, and end as far off as the limit leaves them."""

    def __init__(self):
        time = types.SimpleNamespace(time=np.arange(9))
        self.stretch = types.SimpleNamespace(tour=time)
        self.period = 0.1
        self.asked = []

    def look(self, k, key, aside=(0.0, 0.0)):
        return Seen(None, None, jaxlie.SE3.identity())

    def cloud(self, seen, channels, sensing):
        return float(channels), (channels, sensing), 3

    def window(self, setting, centre):
        return setting.window, None, 0

    def register(self, setting, cloud, window, start, truth):
        self.asked.append((setting, cloud))
        needs = 5 if setting.voxel == 1.0 else 40
        far = 0.0 if setting.iterations >= needs else 1.0
        one = jnp.ones(())
        error = jnp.array([far, 0.0, 0.0])
        return 1.0, Found(truth, error, error, jnp.eye(3), jnp.asarray(far == 0), needs * one, one, one)


def _grid() -> tuple[Grid, _Stub]:
    bench = _Stub()
    params = FactorialParams(channels=(64, 128), scans=2)
    return factorial.run(bench, params, 0, lambda *_: None), bench


def test_the_grid_holds_every_cell_and_repeats_nothing_that_converged():
    grid, bench = _grid()
    assert grid.distance.shape == (2, 2, 3, 2, 2, 2, 2)
    # Coarse voxels need one registration, fine ones all three limits.
    assert len(bench.asked) == 2 * 2 * (2 * 2 * 2) * (1 + 3)
    cells = factorial.cells(grid, 0.5, 0.1)
    assert len(cells["method"]) == 96
    for k in range(96):
        expected = 100.0 if cells["voxel [m]"][k] == 1.0 or cells["iterations"][k] == 64 else 0.0
        assert cells["success [%]"][k] == expected
        assert cells["scan [ms]"][k] == cells["channels"][k] + cells["window [m]"][k] + 1
    effects = factorial.effects(grid, 0.5, 0.1)
    shares = dict(zip(zip(effects["axis"], effects["level"], strict=True), effects["success [%]"], strict=True))
    assert shares["voxel [m]", "1.0"] == 100
    assert shares["voxel [m]", "0.5"] == pytest.approx(100 / 3)
    assert shares["iterations", "64"] == 100
    assert shares["channels", "64"] == shares["channels", "128"] == pytest.approx(200 / 3)
    assert len(factorial.records(grid)["error_m"]) == grid.distance.size
    assert factorial.summary(grid, 0.5, 0.1)["most_dropped_voxels"] == 3
    assert factorial.thresholds(grid, 0.5)["wrong"] == [32, 32, 32, 0, 0, 0] * 2


def test_a_program_is_compiled_once_for_each_set_of_shapes():
    programs = BenchPrograms()

    def double(x, times):
        return x * times

    assert float(programs(double, jnp.ones(()), times=2)[1]) == 2
    assert float(programs(double, 3 * jnp.ones(()), times=2)[1]) == 6
    assert programs.count() == {"double": 1}
    assert float(programs(double, jnp.ones(()), times=3)[1]) == 3
    assert programs(double, jnp.ones(2), times=3)[1].shape == (2,)
    assert programs.count() == {"double": 3}


def test_the_real_pair_is_left_out_with_a_reason(tmp_path, monkeypatch):
    assert "pair.use" in pair.missing(PairParams(use=False))
    monkeypatch.setenv("URBANJAX_DATA", str(tmp_path))
    assert "URBANJAX_DATA" in pair.missing(PairParams())


def test_presets_override_only_what_the_study_has():
    assert config.to_params(RegisterStudy, config.schema(RegisterStudy)) == RegisterStudy()
    for preset in (REPOSITORY / "configs/register/preset").glob("*.yaml"):
        assert (
            config.to_params(RegisterStudy, yaml.safe_load(preset.read_text()), source=preset.name) != RegisterStudy()
        )


@pytest.mark.slow
def test_figures_are_drawn(tmp_path):
    grid, _ = _grid()
    figures.draw_rows(_tracks(lost=True), np.full(6, 10.0), 0.1, 0.5, tmp_path / "rows.png")
    figures.draw_effects(grid, 0.5, 0.1, tmp_path / "effects.png")
    figures.draw_cells(grid, 0.5, tmp_path / "cells.png")
    figures.draw_thresholds(grid, 0.5, tmp_path / "thresholds.png")
    found = Calibration(7.0, 0.95, _errors(50, 7.0, 1), _errors(50, 7.0, 2))
    figures.draw_calibration(found, tmp_path / "calibration.png")
    assert all((tmp_path / f"{name}.png").stat().st_size > 5000 for name in ("rows", "effects", "cells", "thresholds"))


@pytest.mark.slow
def test_row_8_holds_the_pose_from_odometry():
    study = RegisterStudy()
    world = study.world.replace(mapping=study.world.mapping.replace(spacing=15.0))
    there = stretch.build(world, study.localizer, lambda *_: None)
    bench = Bench(there, study.localizer, world.sensor, study.neighbours)
    found = rows.drive(bench, study.rows.replace(scans=4), 0, lambda *_: None)
    assert found[PAPER[7].setting, "predicted"].distance.max() < 0.1
    assert all(track.dropped < 1000 for track in found.values())
