"""The localizer on a furnished street: accurate, carried on through lost scans, and never compiled twice."""

import jax
import jax.numpy as jnp
import jaxlie
import numpy as np
import pytest

from tests.localization.conftest import PERIOD, lane_offset
from urbanjax.localization import lidar, motion
from urbanjax.localization.types import Health, Sign
from urbanjax.registration import voxelmap
from urbanjax.types import ScenarioError


def errors(drive) -> np.ndarray:
    pairs = zip(drive.found, drive.truth, strict=True)
    return np.array([np.asarray(found.pose.translation()) - np.asarray(ego.position) for found, ego in pairs])


def test_follows_the_truth(drive):
    away = np.linalg.norm(errors(drive), axis=1)
    assert away[:12].max() < 0.08
    assert away[20:].max() < 0.08
    assert [int(found.health) for found in drive.found[:12]] == [Health.NORMAL] * 12


def test_lost_scans_are_predicted_and_named_until_scans_are_good_again(drive):
    health = [int(found.health) for found in drive.found]
    assert health[12:18] == [Health.PREDICT] * 6
    assert health[18:] == [Health.NORMAL] * 12
    assert all(int(found.info.reason) == Sign.SCAN or found.info.signs[Sign.SCAN] > 1 for found in drive.found[12:16])
    assert np.linalg.norm(errors(drive), axis=1)[12:18].max() < 0.2


def test_prediction_is_the_composition_of_eq_9_and_10(drive):
    before, found = drive.states[12].T_map_body, drive.found[12]
    moved = before.inverse() @ found.info.T_map_predicted
    np.testing.assert_allclose(moved.translation()[:2], [10.0 * PERIOD, 0.0], atol=1e-3)
    np.testing.assert_allclose(found.pose.translation(), found.info.T_map_predicted.translation()[:2], atol=1e-5)


def test_uncertainty_grows_without_scans_and_shrinks_with_them(drive):
    size = [float(np.linalg.det(found.covariance)) for found in drive.found]
    assert size[12] < size[13] < size[14] < size[15]
    assert size[17] < size[15]
    for found in drive.found:
        assert np.linalg.eigvalsh(np.asarray(found.covariance, float)).min() > 0


def test_odometry_alone_knows_the_way(drive):
    way = np.asarray(drive.found[-1].info.T_start_body.translation())
    np.testing.assert_allclose(way[:2], [10.0 * PERIOD * 29, 0.0], atol=0.25)


@pytest.mark.parametrize("start", ["predict_on_failure", "previous"])
def test_starts_of_a_registration(street, drive, start):
    params = street.localizer.replace(start=start)
    state, predicted = drive.states[5], drive.found[5].info.T_map_predicted
    well = lidar._start(params, state, predicted)
    failed = lidar._start(params, state.replace(monitor=state.monitor.replace(health=jnp.asarray(1))), predicted)
    np.testing.assert_allclose(well.parameters(), state.T_map_body.parameters())
    expected = predicted if start == "predict_on_failure" else state.T_map_body
    np.testing.assert_allclose(failed.parameters(), expected.parameters())


def test_nothing_compiles_after_the_first_scan(street, drive):
    before = street.step._cache_size()
    state = drive.states[-1]
    for k in range(3):
        ego = street.ego(92.0 + k)
        _, state = street.step(street.localizer, street.map, street.graph, state, street.observe(ego, 50 + k))
    assert street.step._cache_size() == before == 1


def test_a_world_5_km_away_changes_less_than_a_millimetre(street, drive):
    state = drive.states[5]
    far = jnp.array([5000.0, -3000.0, 0.0])
    cells = jnp.round(far / street.map.resolution).astype(jnp.int32)
    world = street.map.replace(first=street.map.first + cells)
    moved = state.replace(T_map_body=jaxlie.SE3(state.T_map_body.parameters().at[4:].add(far)))
    seen = street.observe(street.ego(65.0), 5)
    lanes = ("centre", "left", "right")
    graph = street.graph.replace(**{name: getattr(street.graph, name) + far[None, None, :2] for name in lanes})
    here, _ = street.step(street.localizer, street.map, street.graph, state, seen)
    there, _ = street.step(street.localizer, world, graph, moved, seen)
    away = np.asarray(there.pose.translation(), float) - np.asarray(far[:2], float)
    np.testing.assert_allclose(away, here.pose.translation(), atol=1e-3)


def test_without_a_scan_it_says_so(street, drive):
    seen = street.observe(street.ego(65.0), 5).replace(scan=None)
    with pytest.raises(ScenarioError, match=r"observation\.scan"):
        lidar.step(street.localizer, street.map, street.graph, drive.states[5], seen)


def test_held_in_the_lane_that_the_camera_sees(street, drive):
    """A prediction off to the side is put where the seen lane offset says, and only there."""
    graph, pose = street.graph, drive.states[5].T_map_body
    seen = jnp.asarray(0.4)
    off_lane, keep = jax.jit(lidar.off_lane), jax.jit(lidar._keep_lane)
    aside = off_lane(graph, pose, expected=seen)
    kept = keep(graph, pose, aside, jnp.asarray(True))
    assert abs(float(off_lane(graph, kept, expected=seen))) < 1e-4
    assert abs(float(kept.translation()[0] - pose.translation()[0])) < 1e-4
    left_alone = keep(graph, pose, aside, jnp.asarray(False))
    np.testing.assert_array_equal(left_alone.parameters(), pose.parameters())


@pytest.mark.parametrize(
    ("offset", "valid", "age", "known"),
    [
        (0.4, True, 0.0, True),
        (0.4, True, 0.5, True),
        (0.4, False, 0.0, False),
        (0.4, True, 0.6, False),
        (0.4, True, np.nan, False),
        (np.nan, True, 0.0, False),
    ],
)
def test_a_lane_offset_that_is_lost_or_old_is_not_known(street, drive, offset, valid, age, known):
    """Only where the lane is known is the vehicle held in it; otherwise the pose is searched for."""
    assert bool(lane_offset(offset, valid, age).known(street.localizer.health.lane_age)) == known
    lost = street.observe(street.ego(65.0), 5, lost=True, lane=(offset, valid, age))
    monitor = drive.states[5].monitor
    long = monitor.replace(health=jnp.asarray(Health.PREDICT, jnp.int32), failing=jnp.asarray(5.0))
    state = drive.states[5].replace(monitor=long)
    located, _ = street.step(street.localizer, street.map, street.graph, state, lost)
    assert int(located.health) == (Health.LANE if known else Health.RELOCALIZE)
    aside = lidar.off_lane(street.graph, motion.spatial(located.pose), expected=0.0)
    predicted = lidar.off_lane(street.graph, located.info.T_map_predicted, expected=0.0)
    np.testing.assert_allclose(aside, 0.4 if known else predicted, atol=1e-3)
    assert np.all(np.isfinite(located.info.signs))


@pytest.mark.slow  # registration/test_align.py has the gradient of a registration by default
def test_pose_follows_the_map_by_gradient(street, drive):
    """Moving the map moves the pose: the derivative of x to a shift of all means along x is 1."""
    state, seen = drive.states[5], street.observe(street.ego(65.0), 5)

    def x(shift):
        rows = street.map.rows.at[:, 0].add(shift)
        located, _ = lidar.step(street.localizer, street.map.replace(rows=rows), None, state, seen)
        return located.pose.translation()[0]

    slope = jax.jit(jax.grad(x))(jnp.zeros(()))
    np.testing.assert_allclose(slope, 1.0, atol=0.02)


def test_window_holds_what_the_whole_map_holds(street):
    params = street.localizer.sliding.cut
    window, missed = jax.jit(voxelmap.cut)(
        street.map, jnp.array([100.0, 0.0, 0.0]), radius=jnp.asarray(30.0), params=params
    )
    place = (street.map.cell + street.map.first[None]) * street.map.resolution + street.map.rows[:, :3]
    inside = np.hypot(place[:, 0] - 100.0, place[:, 1]) < 30.0
    assert int(missed) == 0
    assert int((window.rows[:, 9] > 0).sum()) == int(inside.sum())
