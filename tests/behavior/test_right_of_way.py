"""Right of way: who is waited for, and where, on roads of the builders."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.scenes import objects_of
from urbanjax.behavior import encounters, right_of_way
from urbanjax.behavior.params import BehaviorParams
from urbanjax.behavior.situation import Body, body_of
from urbanjax.course import course_between
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning import situation as situations
from urbanjax.planning.prediction import Ways
from urbanjax.planning.situation import SituationParams
from urbanjax.roadmap.builders import intersection, roundabout
from urbanjax.roadmap.corridor import CorridorParams, WindowParams, window
from urbanjax.roadmap.links import sample
from urbanjax.roadmap.progress import to_world
from urbanjax.types import Observation, Odometry, RoadUser, Signals, SignalState, VehicleState, as_arrays
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.params import VehicleParams

VEHICLE, PARAMS = as_arrays(VehicleParams()), as_arrays(BehaviorParams())
STATION = jnp.arange(41) * 3.0
LEG = 100.0  # m
WEST, SOUTH, EAST, NORTH = range(4)


@pytest.fixture(scope="module")
def crossing():
    """From the south, which yields, straight on to the north."""
    return course_between(intersection(signalised=False, n_lanes=1), SOUTH, goal=4 + NORTH)


@pytest.fixture(scope="module")
def main_road():
    """From the west, which has priority, straight on to the east."""
    return course_between(intersection(signalised=False, n_lanes=1), WEST, goal=4 + EAST)


@pytest.fixture(scope="module")
def left_turn():
    """From the west to the left, with signals."""
    return course_between(intersection(signalised=True, n_lanes=1), WEST, goal=4 + NORTH)


def on_link(graph, link, station, speed, kind=RoadUser.VEHICLE):
    at = sample(graph, jnp.array([link]), station=jnp.array([float(station)]))
    return (*np.asarray(at.position[0]), float(at.heading[0]), speed, int(kind))


@jax.jit
def gives_way(course, station, speed, objects, signals, relaxation):
    position, heading, _ = to_world(course.corridor, station[None], offset=jnp.zeros(1))
    zero = jnp.zeros(())
    ego = VehicleState(position[0], heading[0], speed, zero, zero)
    odometry = Odometry(*(zero for _ in Odometry.__dataclass_fields__))
    seen = Observation(odometry=odometry, objects=objects, signals=signals)
    found = situations.look(as_arrays(SituationParams()), course, station=station, ego=ego, observation=seen)
    grid = station + STATION
    time = STATION / jnp.maximum(speed, 4.0)
    driving = Driving(VEHICLE, PARAMS.right_of_way, relaxation, 0.1)
    body = body_of(found, VEHICLE)
    way = right_of_way.give_way(found, driving, body=body, station=grid, time=time)
    cap = jnp.asarray(20.0)
    return way, right_of_way.speed(way, driving.of(PARAMS), speed=speed, cap=cap)


def way(course, station, speed, *rows, shown=(), relaxation=None):
    kind = jnp.asarray([row[4] for row in rows], jnp.int32)
    objects = objects_of([row[:4] for row in rows], kind)
    state = jnp.asarray([int(x) for x in shown], jnp.int32)
    signals = Signals(state, jnp.full(len(state), 5.0), jnp.ones(len(state), bool))
    relaxation = as_arrays(relaxation or Relaxation())
    return gives_way(course, jnp.asarray(float(station)), jnp.asarray(float(speed)), objects, signals, relaxation)


def test_one_on_the_main_road_is_waited_for_before_the_line(crossing):
    found, speed = way(crossing, 80.0, 6.0, on_link(crossing.graph, WEST, 75.0, 10.0))
    assert found.waits == 1
    # Front bumper at 83.75 m, the line at the end of the leg.
    assert float(found.distance[np.argmax(found.degree)]) <= LEG - 83.75 + 0.1
    assert speed < 7.0


def test_one_far_off_is_not_waited_for(crossing):
    assert way(crossing, 90.0, 6.0, on_link(crossing.graph, WEST, 5.0, 8.0))[0].waits == 0


def test_the_one_who_yields_is_not_waited_for_unless_it_cannot_stop(main_road):
    comes = [on_link(main_road.graph, SOUTH, station, 8.0) for station in (70.0, 98.0)]
    assert way(main_road, 84.0, 8.0, comes[0])[0].waits == 0
    assert way(main_road, 84.0, 8.0, comes[1])[0].waits == 1


def test_a_leader_and_a_follower_are_no_encounters(crossing):
    rows = [on_link(crossing.graph, SOUTH, station, 5.0) for station in (70.0, 95.0)]
    assert way(crossing, 82.0, 6.0, *rows)[0].waits == 0


def test_who_turns_left_waits_for_those_who_come_the_other_way_at_green_only(left_turn):
    comes = on_link(left_turn.graph, EAST, 80.0, 9.0)
    green, red = SignalState.GREEN, SignalState.RED
    assert way(left_turn, 92.0, 5.0, comes, shown=(green, red, green, red))[0].waits == 1
    assert way(left_turn, 92.0, 5.0, comes, shown=(green, red, red, red))[0].waits == 0


@pytest.mark.parametrize(("walks", "expected"), [(1.5, 1), (-1.5, 0)])
def test_a_pedestrian_who_steps_out_is_waited_for_and_one_who_walks_away_is_not(main_road, walks, expected):
    at = sample(main_road.graph, jnp.array([WEST]), station=jnp.array([60.0]))
    x, y = np.asarray(at.position[0])
    heading = float(at.heading[0]) + np.pi / 2 * np.sign(walks)
    found, speed = way(main_road, 30.0, 10.0, (x, y - 3.0, heading, abs(walks), RoadUser.PEDESTRIAN))
    assert found.waits == expected
    assert (speed < 12.0) == bool(expected)


def test_one_in_the_ring_is_waited_for_and_one_who_wants_in_is_not():
    graph = roundabout()
    course = course_between(graph, WEST, goal=4 + EAST)
    line = np.asarray(course.corridor.line)
    assert line[110] == pytest.approx(LEG, abs=1.0)
    ring = on_link(graph, 8 + 4 * NORTH + 2, 2.0, 6.0)  # the arc that leads to the west
    assert way(course, 90.0, 5.0, ring)[0].waits == 1
    inside = float(np.flatnonzero(np.asarray(course.corridor.lane_link)[:, 2] == 8 + 4 * WEST + 2)[0])
    wants_in = on_link(graph, SOUTH, 90.0, 5.0)
    assert way(course, inside + 1.0, 5.0, wants_in)[0].waits == 0


def test_degrees_tend_to_the_hard_choice(crossing):
    rows = [on_link(crossing.graph, WEST, 75.0, 10.0), on_link(crossing.graph, EAST, 5.0, 8.0)]
    hard, speed = way(crossing, 80.0, 6.0, *rows)
    soft, near = way(crossing, 80.0, 6.0, *rows, relaxation=Relaxation(0.01, "soft"))
    np.testing.assert_allclose(soft.degree, hard.degree, atol=0.05)
    np.testing.assert_allclose(near, speed, atol=0.3)


@pytest.mark.parametrize(("n_stations", "spacing"), [(256, 1.0), (60, 1.0), (256, 0.5)])
def test_places_beside_the_route_are_right_in_short_windows_and_fine_ones(n_stations, spacing):
    params = CorridorParams(spacing=spacing)
    course = course_between(intersection(signalised=False, n_lanes=1), WEST, goal=4 + EAST, corridor=params)
    road = window(course.corridor, jnp.asarray(20.0), params=as_arrays(WindowParams(n_stations=n_stations)))
    along, aside = np.array([22.0, 26.3, 28.9]), np.array([2.0, -1.0, 0.0])
    position = to_world(course.corridor, jnp.asarray(along), offset=jnp.asarray(aside))[0]
    many = jnp.zeros(1)
    ways = Ways(position[None], jnp.asarray([[0.0, 4.4, 7.0]]), many[:, None], *[many] * 4, many == 0)
    zero = jnp.zeros(())
    body = Body(rear=zero + 19.0, front=zero + 23.7, offset=zero, speed=zero)
    station, offset, same = encounters.beside_route(road, ways, body=body)
    np.testing.assert_allclose(station[0], along, atol=1e-2)
    np.testing.assert_allclose(offset[0], aside, atol=1e-2)
    assert np.all(np.asarray(same) > 0.7)
