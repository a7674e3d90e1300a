"""What happened in a drive, told from logs that say it plainly: one lane each way, 120 m along x."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.evaluation.test_metrics import VEHICLE, L, make
from tests.scenes import course_along, one_shape
from urbanjax.evaluation.case import Case
from urbanjax.evaluation.facts import INSIDE, facts
from urbanjax.roadmap.builders import RoadStyle, two_way
from urbanjax.roadmap.graph import RoadType
from urbanjax.sim import lanes as tables
from urbanjax.sim.agents import TrafficParams
from urbanjax.sim.scenarios.scenario import ego_at, traffic, world
from urbanjax.sim.signals import SignalProgram

WIDTH, LIMIT, STEPS, LENGTH = 3.5, 14.0, 8, 120.0
AWAY = ((500.0, 0.0, 0.0, 0.0), (600.0, 0.0, 0.0, 0.0))
ON = 40.0 + np.arange(STEPS)  # m, along the road
OVER = np.linspace(0, WIDTH, STEPS)  # m, from one lane into the other


@jax.jit
def told(log, case):
    found = facts(log, case, vehicle=VEHICLE)
    return found, found.duration, found.way


@pytest.fixture(scope="module")
def place():
    """The case of that road, with a signal that turns from green to red after 0.25 s and no stop line."""
    graph = one_shape(two_way(1, 1, length=LENGTH, style=RoadStyle(lane_width=WIDTH, speed_limit=LIMIT)))
    graph = graph.replace(n_signals=1)
    none = jnp.zeros(1)
    nobody = traffic(
        jnp.zeros(1, jnp.int32), none, speed=none, limit=LIMIT, params=TrafficParams(), valid=jnp.zeros(1, bool)
    )
    start = world(ego_at(jnp.asarray(ON[0]), jnp.asarray(0.0), speed=jnp.asarray(10.0)), 0, vehicles=nobody)
    shown = SignalProgram(none + 100.0, none, none + 0.0025, none)
    far = jnp.asarray(100.0)
    return Case(course_along(graph, 0, 0).corridor, tables.from_graph(graph), start.replace(signals=shown), far, far)


def what(log, case):
    """Facts, duration and way; leaves made alike, so that all share a program."""
    return jax.device_get(told(*jax.tree.map(np.asarray, (log, case))))


def look(case, x=ON, y=0.0, *, others=AWAY, heading=0.0, **fields):
    log = make(x, others=others, **fields)
    centre = jnp.stack([jnp.asarray(x) * 1.0, jnp.broadcast_to(jnp.asarray(y) * 1.0, STEPS)], axis=1)
    ego = log.ego.replace(position=centre, heading=jnp.full(STEPS, heading))
    return what(log.replace(centre=centre, ego=ego), case)


def asked(case, goal=100.0, limit=100.0):
    return case.replace(goal=jnp.asarray(goal), limit=jnp.asarray(limit))


def test_a_plain_drive(place):
    gas = 0.1 * jnp.arange(STEPS)
    margin = 0.5 + 0.01 * jnp.arange(STEPS)
    how = {"steering": jnp.full(STEPS, 0.1), "acceleration": gas, "road_margin": margin}
    found, duration, way = look(asked(place, goal=44.5, limit=0.5), y=0.4, heading=0.02, **how)
    wanted = {
        "time": 0.1 * np.arange(STEPS),
        "station": ON,
        "offset": 0.4,
        "heading_error": 0.02,
        "along": 10 * np.cos(0.02),
        "speed_limit": LIMIT,
        "yaw_rate": 10 * np.tan(0.1) / VEHICLE.wheelbase,
        "acceleration": gas,
        "lane_offset": 0.4,
        "road_margin": margin,
        "goal": 44.5,
        "limit": 0.5,
    }
    for name, value in wanted.items():
        np.testing.assert_allclose(getattr(found, name), value, atol=1e-4, err_msg=name)
    for name in ("oncoming", "wrong_way", "in_junction", "ran_red", "touches", "first_touch"):
        assert not getattr(found, name).any(), name
    assert found.in_one_lane.all()
    assert found.alive.tolist() == [True] * 6 + [False] * 2  # the step in which the goal is passed is the last one
    assert found.reached
    assert (float(duration), float(way)) == (pytest.approx(0.5), pytest.approx(5.0, abs=1e-3))
    np.testing.assert_allclose(found.ego.position[:, 0], ON)
    np.testing.assert_allclose(found.ego.length, L)
    np.testing.assert_allclose(found.others.position[:, 1, 0], 600.0)


def test_a_drive_ends_with_its_time(place):
    found, duration, way = look(asked(place, goal=44.5, limit=0.2))
    assert found.alive.tolist() == [True] * 3 + [False] * 5
    assert not found.reached
    assert (float(duration), float(way)) == (pytest.approx(0.2), pytest.approx(2.0, abs=1e-3))


def test_a_drive_into_the_oncoming_lane(place):
    there = OVER > WIDTH / 2
    aside = OVER - WIDTH * there
    barred = place.replace(corridor=place.corridor.replace(change=jnp.zeros_like(place.corridor.change)))
    for case, wrong in ((place, False), (asked(barred, limit=0.65), True)):
        found, *_ = look(case, y=OVER)
        np.testing.assert_array_equal(found.oncoming, there)
        np.testing.assert_array_equal(found.wrong_way, there & found.alive & wrong)
        np.testing.assert_allclose(found.along, np.where(there, -10, 10), rtol=1e-5)
        np.testing.assert_allclose(found.lane_offset, aside, atol=1e-4)
        np.testing.assert_array_equal(found.in_one_lane, np.abs(aside) + VEHICLE.width / 2 < WIDTH / 2)
    marked, *_ = look(place, y=OVER, offset=jnp.ones(STEPS))  # where the route changes lanes its line lies between them
    assert not marked.in_one_lane.any()


def test_in_a_junction_is_who_is_on_a_link_of_one(place):
    kind = place.lanes.graph.road_type.at[0].set(int(RoadType.JUNCTION))
    lanes = place.lanes.replace(graph=place.lanes.graph.replace(road_type=kind))
    found, *_ = look(place.replace(lanes=lanes), y=OVER)
    np.testing.assert_array_equal(found.in_junction, OVER < WIDTH / 2)


@pytest.mark.parametrize(("line", "ran"), [(44.9, None), (45.9, 4), (47.9, 6)])
def test_a_line_crossed_at_red(place, line, ran):
    """The front bumper is 2.35 m ahead; the signal shows green in steps 0 to 2."""
    road = place.corridor
    there = jnp.arange(road.has_stop.shape[0]) < 1
    road = road.replace(
        stop_station=jnp.full_like(road.stop_station, line), stop_signal=0 * road.stop_signal, has_stop=there
    )
    found, *_ = look(place.replace(corridor=road))
    assert np.flatnonzero(found.ran_red).tolist() == ([] if ran is None else [ran])
    late, *_ = look(asked(place.replace(corridor=road), limit=0.3))
    assert not late.ran_red.any()


def test_a_touch_begins_once_and_counts_while_the_drive_lasts(place):
    gap = np.array([6.0, 4.0, 4.0, 6.0, 6.0, 4.0, 4.0, 6.0])
    log = make(ON, others=AWAY)
    beside = jnp.stack([jnp.asarray(ON + gap), jnp.zeros(STEPS)], axis=1)
    here = jnp.stack([jnp.asarray(ON), jnp.zeros(STEPS)], axis=1)
    there = jnp.stack([jnp.ones(STEPS, bool), jnp.zeros(STEPS, bool)], axis=1)  # the other one is not there at all
    them = log.traffic.replace(position=jnp.stack([beside, here], axis=1), valid=there)
    found, *_ = what(log.replace(traffic=them), asked(place, limit=0.5))
    assert found.touches[:, 0].tolist() == [False, True, True, False, False, True, False, False]
    assert np.argwhere(found.first_touch).tolist() == [[1, 0]]
    assert not found.touches[:, 1].any()


def test_the_edge_of_the_road_is_unknown_where_the_map_ends(place):
    x = np.array([1.0, 3.3, 3.4, 60.0, 61.0, 116.6, 116.7, 119.0])
    found, *_ = look(place, x, road_margin=jnp.full(STEPS, -1.0))
    known = (x > L / 2 + INSIDE) & (x < LENGTH - L / 2 - INSIDE)
    np.testing.assert_allclose(found.road_margin, np.where(known, -1.0, INSIDE))
    assert known.sum() == 4
