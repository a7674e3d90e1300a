"""PDM-Closed in the closed loop, all cases in one program: each does what it is for."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.scenes import loop_params
from urbanjax.course import course_between
from urbanjax.drivers import DRIVERS, PdmDriver
from urbanjax.evaluation.collisions import first
from urbanjax.roadmap.builders import RoadStyle, straight
from urbanjax.rollout import rollout
from urbanjax.sim import lanes as tables
from urbanjax.sim.scenarios.scenario import ego_at, traffic, world
from urbanjax.types import as_arrays

LIMIT, STEPS, LENGTH, START = 14.0, 120, 4.7, 20.0
FRONT = LENGTH - 0.95  # m, before the rear axle
# Of each case the ego's speed, the other one's station (its rear), speed and offset, and a stop line (None: none).
CASES = {
    "free": (8.0, None, 0.0, 0.0, None),
    "standing": (10.0, 90.0, 0.0, 0.0, None),
    "aside": (10.0, 90.0, 0.0, -1.6, None),
    "leader": (10.0, 50.0, 6.0, 0.0, None),
    "red": (10.0, None, 0.0, 0.0, 90.0),
    "blocked": (12.0, START + FRONT + 14.0, 0.0, 0.0, None),
    "left": (8.0, 40.0, 3.0, 3.5, None),
}


@pytest.fixture(scope="module")
def scene():
    graph = straight(2, 500.0, style=RoadStyle(lane_width=3.5, speed_limit=LIMIT))
    course, lanes = course_between(graph, 1, goal=1), tables.from_graph(graph)
    params = as_arrays(loop_params().replace(driver=PdmDriver()))
    y = graph.centre[1, 0, 1]

    def start(speed, rear, pace, offset, line):
        there = rear is not None
        others = traffic(
            jnp.ones(1, jnp.int32), jnp.array([rear + LENGTH / 2 if there else 0.0]), speed=jnp.array([pace]),
            limit=LIMIT, params=params.sim.traffic, valid=jnp.array([there]),
        )  # fmt: skip
        beside, size = jnp.array([offset]), jnp.array([LENGTH])
        others = others.replace(offset=beside, offset_from=beside, offset_to=beside, length=size)
        begin = world(ego_at(jnp.asarray(START), y, speed=jnp.asarray(speed)), 1, vehicles=others)
        n = course.corridor.stop_station.shape[0]
        at = jnp.full(n, 0.0 if line is None else line)
        return begin, at, jnp.arange(n) < (line is not None)

    def drive(begin, at, has):
        road = course.corridor.replace(stop_station=at, has_stop=has)
        log, info = rollout(params, course.replace(corridor=road), lanes, begin, STEPS)
        return log, info, first(log, params.vehicle).at_fault

    return drive, jax.tree.map(lambda *x: jnp.stack(x), *(start(*case) for case in CASES.values()))


@pytest.fixture(scope="module")
def runs(scene):
    """Log, info and whether the ego was at fault in a collision, of every case by name."""
    drive, starts = scene
    found = jax.device_get(jax.jit(jax.vmap(drive))(*starts))
    return {name: jax.tree.map(lambda x, i=i: x[i], found) for i, name in enumerate(CASES)}


def gaps(log):
    return log.traffic.position[:, 0, 0] - log.centre[:, 0] - LENGTH


def test_it_is_one_of_the_drivers():
    assert DRIVERS["pdm"] is PdmDriver


def test_nothing_is_hit_and_all_is_finite(runs):
    for name, (log, info, fault) in runs.items():
        assert not fault, name
        assert log.road_margin.min() > 0, name
        assert all(np.isfinite(x).all() for x in jax.tree.leaves((log.ego, log.command, info))), name
        assert ((info.scores >= 0) & (info.scores <= 1)).all(), name
        assert info.scores.shape == (STEPS, 15)


def test_on_a_free_road_it_reaches_the_limit_in_its_lane(runs):
    log, info, _ = runs["free"]
    assert 0.95 * LIMIT < log.ego.speed[-1] <= LIMIT + 1e-3
    assert np.abs(log.offset).max() < 0.05
    assert (info.chosen == 0).all()
    assert not info.braking.any()
    centre, left, right = info.scores[20].reshape(3, 5)
    assert centre[0] == pytest.approx(1, abs=1e-6)
    assert (np.diff(centre) < 0).all()
    np.testing.assert_allclose(left, centre, atol=1e-3)
    assert (right == 0).all()  # a metre to the right the lane is too narrow


def test_a_vehicle_in_the_other_lane_is_let_be(runs):
    log, *_ = runs["left"]
    np.testing.assert_allclose(log.ego.speed, runs["free"][0].ego.speed, atol=1e-3)
    assert np.abs(log.offset).max() < 0.05


def test_it_stops_behind_what_leaves_no_room(runs):
    log, *_ = runs["standing"]
    assert log.ego.speed[-1] < 0.2
    assert 0.8 < gaps(log)[-1] < 2.5
    assert np.abs(log.offset).max() < 1.2


def test_it_passes_where_an_offset_leaves_room(runs):
    log, info, _ = runs["aside"]
    assert gaps(log)[-1] < -2 * LENGTH
    assert 0.7 < log.offset.max() < 1.3
    assert np.isin(info.chosen, np.arange(5, 10)).any()


def test_it_follows_a_slow_leader(runs):
    log, info, _ = runs["leader"]
    following = PdmDriver().following
    wanted = following.jam_distance + following.time_headway * 6.0
    assert log.ego.speed[-1] == pytest.approx(6.0, abs=0.2)
    assert gaps(log)[-1] == pytest.approx(wanted, abs=1.0)
    assert gaps(log).min() > 1
    assert not info.braking.any()


def test_it_stops_before_a_line_that_is_not_open(runs):
    log, *_ = runs["red"]
    assert log.ego.speed[-1] < 0.1
    assert 0.5 < 90.0 - (log.ego.position[-1, 0] + FRONT) < 2.0


def test_it_brakes_in_full_where_nothing_else_helps(runs):
    log, info, _ = runs["blocked"]
    assert info.braking[:10].all()
    np.testing.assert_allclose(log.command.acceleration[:10], -6.0, atol=1e-5)
    assert log.ego.speed[30] < 0.2
    assert gaps(log).min() > 0


@pytest.mark.slow
def test_a_batch_equals_single_runs(scene, runs):
    drive, starts = scene
    alone = jax.jit(drive)
    for i in (1, 2):
        name = list(CASES)[i]
        log, info, _ = jax.device_get(alone(*jax.tree.map(lambda x, i=i: x[i], starts)))
        np.testing.assert_allclose(log.ego.position, runs[name][0].ego.position, atol=1e-3)
        np.testing.assert_array_equal(info.chosen, runs[name][1].chosen)


def test_the_way_against_the_traffic_is_that_of_the_longest_stretch():
    centre = jnp.stack([jnp.arange(9.0), jnp.zeros(9)], axis=-1)[None].repeat(3, 0)
    wrong = jnp.array([[0, 1, 1, 0, 1, 1, 1, 0, 0], [0] * 9, [1] * 9], bool)
    np.testing.assert_allclose(PdmDriver()._against(centre, wrong), [3, 0, 8])
