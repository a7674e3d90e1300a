import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.scenes import objects_of
from urbanjax.planning.prediction import PredictionParams, boxes_at, predict
from urbanjax.roadmap.builders import curve, intersection, straight
from urbanjax.roadmap.builders.specs import RoadStyle
from urbanjax.roadmap.links import sample
from urbanjax.roadmap.locate import locate
from urbanjax.types import Objects, Signals

NONE = Signals(jnp.zeros(0, jnp.int32), jnp.zeros(0), jnp.zeros(0, bool))
ONE, TWO = PredictionParams(branches=1), PredictionParams(branches=2)


@jax.jit
def look_ahead(graph, objects, params):
    locations = locate(graph, objects.position, heading=objects.heading)
    return predict(graph, objects, locations=locations, signals=NONE, params=params)[0]


def objects(*rows) -> Objects:
    """Objects from rows of x, y, heading and speed."""
    return objects_of(rows)


def on_link(graph, link, station, offset=0.0, turned=0.0, speed=10.0):
    at = sample(graph, jnp.array([link]), station=jnp.array([station]))
    h = float(at.heading[0])
    x, y = np.asarray(at.position[0]) + offset * np.array([-np.sin(h), np.cos(h)])
    return x, y, h + turned, speed


@pytest.fixture(scope="module")
def bend():
    return curve(radius=40.0, n_lanes=2, lead=30.0, style=RoadStyle(section=40.0))


def test_objects_start_where_they_are(bend):
    seen = objects(on_link(bend, 0, 5.0, 0.4, 0.1), on_link(bend, 1, 12.0, -0.3, -0.2, 3.0), (500.0, 500.0, 1.0, 5.0))
    found = look_ahead(bend, seen, TWO)
    for b in range(2):
        np.testing.assert_allclose(found.position[b::2, 0], seen.position, atol=1e-4)
        np.testing.assert_allclose(found.heading[b::2, 0], seen.heading, atol=1e-4)
    assert found.time[0] == 0
    np.testing.assert_allclose(np.diff(found.time), 0.5)


def test_objects_keep_their_lane_and_offset_round_a_bend(bend):
    seen = objects(on_link(bend, 0, 5.0, 0.4, speed=9.0))
    found = look_ahead(bend, seen, ONE)
    turned = np.abs(found.heading[0] - found.heading[0, 0])
    assert turned.max() > 0.9
    at = locate(bend, found.position[0], heading=found.heading[0])
    assert np.all(at.valid)
    np.testing.assert_allclose(at.offset, 0.4, atol=0.02)
    np.testing.assert_allclose(at.heading_error, 0, atol=0.02)
    steps = np.linalg.norm(np.diff(found.position[0], axis=0), axis=1)
    np.testing.assert_allclose(steps, 4.5, rtol=0.02)


def test_an_object_off_the_road_goes_straight_on(bend):
    found = look_ahead(bend, objects((300.0, 300.0, 2.0, 6.0)), TWO)
    direction = np.array([np.cos(2.0), np.sin(2.0)])
    expected = np.array([300.0, 300.0]) + 6.0 * np.asarray(found.time)[:, None] * direction
    np.testing.assert_allclose(found.position[0], expected, atol=1e-3)
    np.testing.assert_allclose(found.heading[0], 2.0, atol=1e-5)
    np.testing.assert_array_equal(found.valid, [True, False])


def test_an_object_across_the_lane_goes_straight_on():
    found = look_ahead(straight(), objects((50.0, 0.0, 1.5, 4.0)), ONE)
    np.testing.assert_allclose(found.heading[0], 1.5, atol=1e-5)
    np.testing.assert_allclose(found.position[0, -1], [50 + 32 * np.cos(1.5), 32 * np.sin(1.5)], atol=1e-3)


def test_the_end_of_the_road_is_left_straight_on():
    found = look_ahead(straight(length=100.0), objects((90.0, 0.0, 0.0, 10.0)), ONE)
    np.testing.assert_allclose(found.position[0, :, 0], 90 + 10 * np.asarray(found.time), atol=1e-3)
    np.testing.assert_allclose(found.position[0, :, 1], 0, atol=1e-4)


def test_a_vehicle_that_turns_away_is_predicted_sideways():
    found = look_ahead(straight(), objects((50.0, 0.0, 0.1, 10.0)), ONE)
    aside = 10 * np.sin(0.1) * (1 - np.exp(-np.asarray(found.time)))
    np.testing.assert_allclose(found.position[0, :, 1], aside, atol=1e-3)
    np.testing.assert_allclose(found.heading[0], 0.1 * np.exp(-np.asarray(found.time)), atol=1e-4)


def test_branches_at_a_fork():
    graph = intersection(signalised=False, n_lanes=1)
    link = int(np.argmax(np.sum(np.asarray(graph.has_successor), axis=1)))
    ways = int(np.sum(np.asarray(graph.has_successor)[link]))
    assert ways >= 2
    seen = objects(on_link(graph, link, float(graph.length[link]) - 10, speed=8.0))
    found = look_ahead(graph, seen, PredictionParams(branches=4))
    np.testing.assert_array_equal(found.valid, np.arange(4) < ways)
    ends = np.asarray(found.position[:ways, -1])
    apart = np.linalg.norm(ends[:, None] - ends[None], axis=-1) + 100 * np.eye(ways)
    assert apart.min() > 10
    np.testing.assert_allclose(found.position[0, :2], found.position[1, :2], atol=1e-3)


def test_boxes_at_interpolates_in_time(bend):
    found = look_ahead(bend, objects(on_link(bend, 0, 5.0), on_link(bend, 1, 5.0, speed=4.0)), ONE)
    position, heading = boxes_at(found, found.time)
    np.testing.assert_allclose(position, found.position, atol=1e-3)
    np.testing.assert_allclose(heading, found.heading, atol=1e-5)
    between, _ = boxes_at(found, jnp.array([0.75]))
    np.testing.assert_allclose(between[:, 0], (found.position[:, 1] + found.position[:, 2]) / 2, atol=1e-3)
    beyond, _ = boxes_at(found, jnp.array([9.0]))
    velocity = (found.position[:, -1] - found.position[:, -2]) / 0.5
    np.testing.assert_allclose(beyond[:, 0], found.position[:, -1] + velocity, atol=1e-2)


def test_the_speed_has_a_gradient(bend):
    seen = objects(on_link(bend, 0, 5.0))

    def end(speed):
        return jnp.sum(look_ahead(bend, seen.replace(speed=speed), ONE).position[0, -1] ** 2)

    gradient = jax.grad(end)(seen.speed)
    assert np.all(np.isfinite(gradient))
    assert np.abs(gradient).max() > 1


def test_padding_changes_nothing(bend):
    rows = [on_link(bend, 0, 5.0), on_link(bend, 1, 9.0, speed=4.0)]
    few, many = objects(*rows), objects(*rows, (0.0, 0.0, 0.0, 0.0))
    many = many.replace(valid=jnp.array([True, True, False]))
    a, b = look_ahead(bend, few, TWO), look_ahead(bend, many, TWO)
    np.testing.assert_array_equal(a.position, b.position[:4])
    assert not np.any(b.valid[4:])
