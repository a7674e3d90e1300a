"""A lost pose is found among the lanes around, or is said not to be found."""

import functools

import jax
import jax.numpy as jnp
import jaxlie
import numpy as np
import pytest

from tests.scenes import loop_params
from urbanjax import stack
from urbanjax.course import course_between
from urbanjax.localization import relocalize
from urbanjax.localization.relocalize import RelocalizeParams
from urbanjax.localization.types import Health
from urbanjax.roadmap.builders import district, straight
from urbanjax.types import as_arrays

PARAMS = RelocalizeParams(starts=24, finalists=4)


@pytest.fixture(scope="module")
def search(street):
    run = jax.jit(relocalize.relocalize)
    return functools.partial(run, as_arrays(PARAMS), street.localizer, world=street.map)


def test_starts_are_the_nearest_lane_points(street, drive):
    pose = drive.states[5].T_map_body
    starts = relocalize.lane_starts(street.graph, pose, count=24)
    here = np.asarray(pose.translation())[:2]
    away = np.linalg.norm(np.asarray(starts.translation())[:, :2] - here, axis=1)
    everywhere = np.linalg.norm(np.asarray(street.graph.centre).reshape(-1, 2) - here, axis=1)
    np.testing.assert_allclose(np.sort(away), np.sort(everywhere)[:24], atol=1e-3)  # lane points are 6 m apart


def test_long_lanes_have_starts_between_their_points():
    """A lane of 400 m has a point every 13 m: starts are denser, and none is spent on a place that there is not."""
    graph = straight(1, 400.0)
    pose = jaxlie.SE3.from_translation(jnp.array([120.0, 2.0, 0.0]))
    starts = jax.jit(relocalize.lane_starts, static_argnames="count")(graph, pose, count=16)
    x = np.sort(np.asarray(starts.translation())[:, 0])
    assert np.diff(x).max() < 4.0
    assert abs(x.mean() - 120.0) < 4.0
    few = jax.jit(relocalize.lane_starts, static_argnames="count")(graph, pose, count=300)
    place = np.asarray(few.translation())[:, :2]
    assert np.abs(place[:, 1]).max() < 4.0
    assert len(np.unique(place.round(2), axis=0)) < 300
    assert np.linalg.norm(place[-1] - [120.0, 0.0]) < 4.0  # the nearest one stands for those that there are not


def test_crossing_lanes_share_their_starts():
    """At a junction many lanes lie on one spot: starts reach farther than the nearest lane points do."""
    graph = district()
    corner = int(np.argmax(np.asarray(graph.has_conflict).sum(1)))
    middle = graph.centre[corner, 16]
    pose = jaxlie.SE3.from_translation(jnp.array([middle[0], middle[1], 0.0]))
    starts = jax.jit(relocalize.lane_starts, static_argnames="count")(graph, pose, count=64)
    away = np.linalg.norm(np.asarray(starts.translation())[:, :2] - np.asarray(middle), axis=1)
    nearest = np.sort(np.linalg.norm(np.asarray(graph.centre).reshape(-1, 2) - np.asarray(middle), axis=1))[:64]
    assert away.max() > 1.2 * nearest.max()
    cells = {(*np.floor(p[:2] / 3.0).astype(int),) for p in np.asarray(starts.translation())}
    assert len(cells) > 32


def test_a_vehicle_put_elsewhere_is_found(street, drive, search):
    lost = drive.states[5]  # believes to be at x = 64
    seen = street.observe(street.ego(78.0), 9)
    starts = relocalize.lane_starts(street.graph, lost.T_map_body, count=24)
    found, state = search(state=lost, observation=seen, starts=starts)
    assert bool(found.found)
    np.testing.assert_allclose(state.T_map_body.translation()[:2], [78.0, 0.0], atol=0.1)
    assert int(state.monitor.health) == Health.PREDICT
    after, _ = street.step(street.localizer, street.map, street.graph, state, street.observe(street.ego(79.0), 10))
    np.testing.assert_allclose(after.pose.translation(), [79.0, 0.0], atol=0.1)


def test_what_is_not_there_is_not_found(street, drive, search):
    lost = drive.states[5]
    seen = street.observe(street.ego(150.0), 9)
    empty = seen.replace(scan=seen.scan.replace(valid=jnp.zeros_like(seen.scan.valid)))
    starts = relocalize.lane_starts(street.graph, lost.T_map_body, count=24)
    found, state = search(state=lost, observation=empty, starts=starts)
    assert not bool(found.found)
    np.testing.assert_array_equal(state.T_map_body.parameters(), lost.T_map_body.parameters())


def test_the_stack_searches_only_where_it_is_lost(street, drive):
    """`stack.recover` on a localizer that is lost, and on one that is not."""
    params = loop_params()
    params = params.replace(stack=params.stack.replace(localizer="lidar", lidar=street.localizer, search=PARAMS))
    driver = as_arrays(params).handed_down()[0]
    course = course_between(street.graph, 1, goal=1).replace(map=street.map)
    before = stack.init(driver, course, street.ego(64.0).pose)
    seen = street.observe(street.ego(78.0), 9)
    recover = jax.jit(stack.recover)
    for health in (Health.NORMAL, Health.RELOCALIZE, Health.LANE):
        localizer = drive.states[5]
        localizer = localizer.replace(monitor=localizer.monitor.replace(health=jnp.asarray(int(health), jnp.int32)))
        after = recover(driver, course, state=before.replace(localizer=localizer), observation=seen)
        expected = 64.0 if health == Health.NORMAL else 77.0  # where it was a period before it sees this
        np.testing.assert_allclose(after.localizer.T_map_body.translation()[0], expected, atol=0.2)
        np.testing.assert_array_equal(after.station, before.station)
    located, _ = street.step(street.localizer, street.map, street.graph, after.localizer, seen)
    np.testing.assert_allclose(located.info.T_map_predicted.translation()[0], 78.0, atol=0.1)
    np.testing.assert_allclose(located.pose.translation(), [78.0, 0.0], atol=0.1)
    assert not bool(located.info.failed)
