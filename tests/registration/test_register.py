"""Two plain arrays in, a pose out: anywhere on earth, nothing dropped, and one line for what is no scan."""

import jaxlie
import numpy as np
import pytest

from tests.registration.conftest import courtyard
from urbanjax.registration import DroppedPointsWarning, register
from urbanjax.registration.register import size
from urbanjax.types import CloudError, ConfigError, Status

POINTS = 1000
bare = register.__wrapped__  # past the suite's own check of types, as a user calls it


@pytest.fixture(scope="module")
def scans(truth):
    """Source and target [1000, 3], and T_target_source [4, 4]."""
    pose = np.asarray(truth.as_matrix(), float)
    back = np.linalg.inv(pose)
    return courtyard(POINTS, 1) @ back[:3, :3].T + back[:3, 3], courtyard(POINTS, 2), pose


@pytest.fixture(scope="module")
def found(scans):
    return register(*scans[:2], resolution=2.0)


def test_the_pose_is_found_and_its_covariance_covers_the_error(scans, found):
    assert found.status == Status.OK
    assert (found.converged, found.dropped) == (True, 0)
    assert found.inlier_share > 0.9
    assert found.mahalanobis(scans[2]) < 3.55
    assert np.linalg.norm(found.T_target_source[:3, 3] - scans[2][:3, 3]) < 0.03
    assert found.mahalanobis(found.T_target_source) < 1e-6


def test_the_mahalanobis_distance_is_that_of_the_twist(found):
    twist = np.array([0.01, -0.02, 0.03, 0.2, -0.1, 0.05])
    away = np.asarray(jaxlie.SE3.exp(np.concatenate([twist[3:], twist[:3]])).as_matrix(), float)
    expected = np.sqrt(twist @ np.linalg.solve(found.covariance, twist))
    assert found.mahalanobis(found.T_target_source @ away) == pytest.approx(expected, rel=2e-3)


def test_coordinates_of_a_city_keep_their_millimetres(scans, found):
    """Both scans moved by whole kilometres: the same pose between them, the same covariance about the middle."""
    source, target, _ = scans
    moves = np.array([312_000.0, 4_120_000.0, 40.0]), np.array([-5000.0, 300.0, 0.0])
    start = np.eye(4)
    start[:3, 3] = moves[0] - moves[1]
    far = register(source + moves[1], target + moves[0], resolution=2.0, start=start)
    back = far.T_target_source @ np.append(source.mean(0) + moves[1], 1)
    here = found.T_target_source @ np.append(source.mean(0), 1)
    np.testing.assert_allclose(back[:3] - moves[0], here[:3], atol=2e-3)
    # A rotation about the far origin moves the scan: its variance is in that of the translation there.
    lever = np.linalg.norm(moves[1])
    heading = np.sqrt(far.covariance[2, 2])
    assert np.sqrt(np.trace(far.covariance[3:5, 3:5])) == pytest.approx(lever * heading, rel=0.1)


@pytest.mark.parametrize("method", ["ndt", pytest.param("gicp", marks=pytest.mark.slow)])
def test_other_methods(scans, method):
    found = register(*scans[:2], resolution=2.0, method=method)
    assert np.linalg.norm(found.T_target_source[:3, 3] - scans[2][:3, 3]) < 0.05


def test_a_capacity_that_drops_points_warns(scans):
    with pytest.warns(DroppedPointsWarning, match=r"of \d+ voxels found no place in capacity=256: raise it"):
        found = register(*scans[:2], resolution=2.0, capacity=256)
    assert found.dropped > 0


def test_scans_that_share_nothing_have_failed(scans):
    source, target, _ = scans
    start = np.eye(4)
    start[:3, 3] = [500.0, 0.0, 0.0]
    lost = register(source, target, resolution=2.0, start=start)
    assert (lost.status, lost.converged, lost.inlier_share) == (Status.NO_PAIRS, False, 0)
    assert "no point of the source" in lost.status.message
    assert np.sqrt(np.diag(lost.covariance)).min() > 0.02


def reflected():
    pose = np.eye(4)
    pose[0, 0] = -1
    return pose


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"source": np.zeros((3, 500))}, CloudError, r"source has the shape \(3, 500\).*transpose it"),
        ({"target": np.zeros((500, 4))}, CloudError, r"target has the shape \(500, 4\).*take x, y and z"),
        ({"source": np.zeros((0, 3))}, CloudError, "N > 0"),
        ({"source": np.full((500, 3), np.nan)}, CloudError, "source: 500 points are not finite"),
        ({"source": "scan.ply"}, CloudError, "source: str is no array of real numbers"),
        ({"target": 1e6 * np.random.default_rng(0).random((500, 3))}, CloudError, "crop it, or raise resolution"),
        ({"resolution": 0.0}, ConfigError, "resolution is 0.0: it must be a positive number"),
        ({"resolution": np.nan}, ConfigError, "resolution is nan"),
        ({"method": "icp"}, ConfigError, "method is 'icp': use one of vgicp, ndt, gicp"),
        ({"start": np.eye(3)}, ConfigError, r"start has the shape \(3, 3\)"),
        ({"start": reflected()}, ConfigError, "no rotation"),
        ({"resolution": "fine"}, ConfigError, "resolution is 'fine': it must be a positive number"),
        ({"source": np.ones((30, 3))}, CloudError, "source has 30 points"),
        ({"source": np.ones((500, 3))}, CloudError, "source has 1 points when thinned to 0.25 m"),
        ({"source": 1e20 * np.ones((500, 3))}, CloudError, "within 1e.07 m are needed"),
        ({"start": np.full((4, 4), np.nan)}, ConfigError, "start is no pose: it must be finite"),
        ({"start": "here"}, ConfigError, "start: str is no array"),
        ({"params": 3}, ConfigError, "params is a int: give a AlignParams"),
        ({"capacity": 10**12}, ConfigError, "capacity is 1000000000000: it must be a whole number, between 64 and"),
        ({"capacity": 0}, ConfigError, "capacity is 0: it must be a whole number"),
    ],
)
def test_what_is_no_scan_gets_one_line(scans, change, error, message):
    given = {"source": scans[0], "target": scans[1]} | change
    with pytest.raises(error, match=message) as caught:
        bare(given.pop("source"), given.pop("target"), **given)
    assert "\n" not in str(caught.value)


def test_sizes_hold_what_they_are_for_and_are_few():
    sizes = {size(n) for n in range(1, 100_000)}
    assert all(n <= size(n) <= max(1.25 * n + 1, 64) for n in range(1, 100_000, 7))
    assert len(sizes) < 50
