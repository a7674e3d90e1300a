import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.geometry.boxes import box, box_gap
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning import clearance
from urbanjax.planning.clearance import ClearanceParams, Passage
from urbanjax.planning.prediction import boxes_at
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.params import VehicleParams

VEHICLE, PARAMS = VehicleParams(), ClearanceParams()
DRIVING = Driving(VEHICLE, PARAMS, Relaxation(), 0.1)


@jax.jit
def gaps(way, prediction, ignored):
    return clearance.gaps(way, DRIVING, prediction=prediction, ignored=ignored)


@jax.jit
def followers(state, prediction):
    return clearance.followers(state, DRIVING, prediction=prediction)


def passage(scenes, window, station, time, offset=0.0, step=0.0, step_time=0.0):
    places = [scenes.place(window, s, offset) for s in station]
    n = len(places)
    return Passage(
        position=jnp.asarray(np.stack([p for p, _ in places]), jnp.float32),
        heading=jnp.asarray([h for _, h in places], jnp.float32),
        time=jnp.asarray(time, jnp.float32),
        step=jnp.full(n, step),
        step_time=jnp.full(n, step_time),
    )


def test_gaps_are_those_of_the_boxes_at_the_time_of_passing(scenes):
    window = scenes.road(curvature=0.01)
    cars = scenes.traffic(window, [(60.0, 3.5, 5.0), (120.0, 0.0, -8.0)], total=2)
    way = passage(scenes, window, [30.0, 50.0, 63.0, 80.0], [0.3, 2.2, 3.1, 7.7])
    found = gaps(way, cars, jnp.zeros(2))
    position, heading = boxes_at(cars, way.time)
    along = jnp.stack([jnp.cos(way.heading), jnp.sin(way.heading)], axis=-1)
    centre = way.position + VEHICLE.centre_offset * along
    for b in range(2):
        size = {"length": jnp.full(4, 4.7), "width": jnp.full(4, 1.9)}
        expected = box_gap(box(centre, way.heading, **size), box(position[b], heading[b], **size))
        np.testing.assert_allclose(found[:, b], np.minimum(expected, PARAMS.far), atol=2e-3)


def test_nothing_is_skipped_between_points(scenes):
    window = scenes.road()
    station, time = [40.0, 52.0], [2.0, 3.2]
    parked = scenes.traffic(window, [(46.0 + VEHICLE.centre_offset, 0.0, 0.0)], total=1)
    assert jnp.min(gaps(passage(scenes, window, station, time), parked, jnp.zeros(1))) > 0
    swept = passage(scenes, window, station, time, step=12.0, step_time=1.2)
    assert jnp.max(gaps(swept, parked, jnp.zeros(1))) < 0


def test_a_leader_of_equal_speed_is_not_swept(scenes):
    window = scenes.road()
    leader = scenes.traffic(window, [(60.0, 0.0, 10.0)], total=1)
    way = passage(scenes, window, [40.0, 52.0], [2.0, 3.2], step=12.0, step_time=1.2)
    still = passage(scenes, window, [40.0, 52.0], [2.0, 3.2])
    args = (leader, jnp.zeros(1))
    np.testing.assert_allclose(gaps(way, *args), gaps(still, *args), atol=1e-3)


def test_invalid_and_ignored_objects_leave_the_way_free(scenes):
    window = scenes.road()
    way = passage(scenes, window, [40.0], [2.0])
    car = scenes.traffic(window, [(40.0, 0.0, 0.0)], total=1)
    assert gaps(way, car, jnp.zeros(1))[0, 0] < 0
    assert gaps(way, car.replace(valid=jnp.array([False])), jnp.zeros(1))[0, 0] == PARAMS.far
    assert gaps(way, car, jnp.ones(1))[0, 0] > PARAMS.far / 2


@pytest.mark.parametrize("curvature", [0.0, 0.02])
def test_followers(scenes, curvature):
    window = scenes.road(curvature=curvature)
    _, state = scenes.ego(window, station=60.0, speed=2.0)
    cars = [
        (40.0, 0.0, 12.0),
        (40.0, 3.5, 12.0),
        (80.0, 0.0, 0.0),
        (120.0, 0.0, -10.0),
        (58.0, 0.0, 5.0),
        (20.0, 0.0, 0.5),
    ]
    found = followers(state, scenes.traffic(window, cars, total=7))
    # Behind us; beside; ahead; oncoming; overlapping us; too slow to matter; no car at all.
    np.testing.assert_array_equal(found, [1, 0, 0, 0, 0, 0, 0])
