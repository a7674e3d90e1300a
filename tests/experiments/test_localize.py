"""What the localization study counts: coverage, divergence, unnoticed errors, recovery and the detector's score."""

import numpy as np
import pytest

from experiments.localize import faults, figures, loop, methods
from experiments.localize.faults import FaultParams, InjectedFault
from experiments.localize.loop import LoopStudy
from experiments.localize.methods import Method
from experiments.localize.track import LocalizedTrack, TrackRow
from urbanjax.localization.types import Health, Sign
from urbanjax.roadmap.builders import straight
from urbanjax.sim.scenarios.tour import Tour
from urbanjax.types import ConfigError


def track(errors, health=None, registered=None, signs=None) -> LocalizedTrack:
    n = len(errors)
    flat = np.stack([np.asarray(errors, float), np.zeros(n), np.zeros(n)], 1)
    other = flat if registered is None else np.stack([np.asarray(registered, float), np.zeros(n), np.zeros(n)], 1)
    marks = np.zeros((n, len(Sign)))
    if signs is not None:
        marks[:, Sign.INLIERS] = signs
    zeros = np.zeros(n)
    rows = TrackRow(
        pose=flat,
        error=flat,
        registered=other,
        odometry=flat,
        covariance=np.zeros((n, 3, 3)),
        health=np.full(n, Health.NORMAL) if health is None else np.asarray(health),
        failed=marks.max(1) > 1,
        signs=marks,
        literal=zeros,
        inlier_share=zeros,
        matching_error=zeros,
        residual=zeros,
        iterations=zeros,
        dropped=np.zeros((n, 2)),
    )
    return LocalizedTrack(np.arange(n), rows, np.ones(n), np.zeros(n, bool), np.zeros(0))


def test_unnoticed_is_the_longest_run_of_wrong_and_normal():
    wrong = [0, 1, 1, 0, 1, 1, 1, 1, 0]
    health = [0, 0, 0, 0, 0, 0, 1, 0, 0]
    assert InjectedFault("kidnapping", 0, 1, 2, track(wrong, health)).unnoticed == 2
    assert InjectedFault("kidnapping", 0, 1, 2, track([0, 0, 0])).unnoticed == 0


@pytest.mark.parametrize(
    ("errors", "health", "expected"),
    [
        ([0, 9, 9, 0, 0, 0], [0, 1, 1, 1, 0, 0], 2),
        ([0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0], 0),
        ([0, 9, 9, 9, 9, 9], [0, 1, 1, 1, 1, 1], None),
        ([0, 9, 9, 0, 9, 0], [0, 0, 0, 0, 0, 0], 3),
    ],
)
def test_recovery_counts_from_the_end_of_the_failure(errors, health, expected):
    assert InjectedFault("scan_loss", 0, 1, 2, track(errors, health)).recovery == expected


def test_area_under_the_curve():
    wrong = np.array([False, False, True, True])
    assert faults.roc(np.array([1.0, 2.0, 3.0, 4.0]), wrong) == 1.0
    assert faults.roc(np.array([4.0, 3.0, 2.0, 1.0]), wrong) == 0.0
    assert faults.roc(np.array([1.0, 3.0, 2.0, 4.0]), wrong) == 0.75
    assert faults.roc(np.ones(4), wrong) == 0.5
    assert faults.roc(np.ones(4), np.zeros(4, bool)) is None


def test_detection_counts_misses_and_false_alarms():
    seen = faults.detection([track([0.0] * 4, registered=[0, 0, 9, 9], signs=[0.1, 1.5, 0.2, 3.0])])
    assert (seen["registrations_wrong"], seen["detector_missed"], seen["detector_false_alarms"]) == (2, 1, 1)
    assert seen["detector_auc"] == 0.75


def method(errors, scans=None) -> Method:
    flat = np.stack([np.asarray(errors, float), np.zeros(len(errors)), np.zeros(len(errors))], 1)
    return Method("m", flat, scans or len(errors), np.ones(len(errors)), 0, flat, len(errors))


def test_coverage_is_of_all_scans_and_divergence_for_good():
    assert method([0.1, 0.2, 0.7, 0.1], scans=8).coverage.value == 3 / 8
    assert method([0.1, 3.0, 0.1, 3.0, 4.0]).diverged == 3
    assert method([0.1, 3.0, 0.1]).diverged is None
    assert method([3.0, 3.0]).diverged == 0


def test_errors_are_seen_from_the_true_body():
    truth = np.array([[10.0, 5.0, np.pi / 2]])
    moved = methods.compose(truth, np.array([[2.0, 1.0, 0.1]]))
    np.testing.assert_allclose(moved, [[9.0, 7.0, np.pi / 2 + 0.1]], atol=1e-12)
    np.testing.assert_allclose(methods.between(truth, moved), [[2.0, 1.0, 0.1]], atol=1e-12)
    wrapped = methods.between(np.array([[0.0, 0.0, -3.1]]), np.array([[0.0, 0.0, 3.1]]))
    np.testing.assert_allclose(wrapped[0, 2], 6.2 - 2 * np.pi, atol=1e-12)


def test_the_table_has_a_column_for_each_method():
    rows = methods.table([method([0.1]), method([0.2])], 0.1)
    assert len(methods.as_printed(rows)["m"]) == len(rows) - 1


def test_failures_are_drawn(tmp_path):
    drives = [InjectedFault(kind, 0, 1, 2, track([0.01, 9, 9, 0.01], [0, 1, 3, 0])) for kind in faults.KINDS]
    figures.draw_faults(drives, 0.1, tmp_path / "failures.png")
    assert (tmp_path / "failures.png").stat().st_size > 5000


@pytest.mark.parametrize(
    ("changes", "message"),
    [({"after": 30.0}, "'world.stretch'"), ({"kidnap": (30.0, 8.0)}, "'faults.kidnap' must rise")],
)
def test_failures_that_do_not_fit_the_drive_are_refused(changes, message):
    drive = Tour(time=np.arange(400) / 10, station=None, ego=None, yaw_rate=None, odometry=None, vehicles=None)
    faults.checked(FaultParams(), drive, 0.1)
    with pytest.raises(ConfigError, match=message):
        faults.checked(FaultParams(**changes), drive, 0.1)


@pytest.mark.parametrize("link", [10_000, 0])
def test_a_loop_that_cannot_start_is_refused(link):
    graph = straight(2, 100.0)
    with pytest.raises(ConfigError, match=r"'loop\.link'"):
        loop.checked(LoopStudy(link=link), graph)
