"""Missions are what their docstrings say: drawn from seeds, on roads of one shape, nobody in the way at once."""

import functools
import inspect
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.evaluation.metrics import overlaps
from urbanjax.evaluation.missions import HARD, MISSIONS, QUALIFICATION, hard, qualification
from urbanjax.evaluation.missions.mission import LONGEST, Mission
from urbanjax.roadmap.graph import RoadType, Rule, Turn
from urbanjax.sim import agents
from urbanjax.sim.agents import TrafficParams
from urbanjax.sim.scenarios.casts import COMFORT, START
from urbanjax.sim.scenarios.stage import StageSize
from urbanjax.types import Objects, RoadUser
from urbanjax.vehicle.model import box_centre
from urbanjax.vehicle.params import VehicleParams

VEHICLE, OTHERS = VehicleParams(), TrafficParams()
SEEDS = range(3)
# Of each road the lanes in the ego's direction where it starts, those against it, and whether the way crosses others.
ROADS = {
    **dict.fromkeys(("overtake", "cut_in", "accident_vehicle", "congestion"), ({2, 3, 4}, {0}, False)),
    **dict.fromkeys(("narrow_passage", "pedestrian"), ({2}, {0}, False)),
    **dict.fromkeys(("unsignalised", "signal_straight", "signal_left", "signal_right"), ({1, 2}, {1, 2}, True)),
    **dict.fromkeys(("oncoming_overtake", "double_parked"), ({1}, {1}, False)),
    "lane_drop": ({2, 3}, {0}, False),
    "roundabout": ({1}, {1}, True),
    "tight_right": ({1}, {1}, True),
    "district": ({2, 3, 4}, {0, 1, 2}, None),  # both
}
MAKERS = {
    name: maker
    for module in (qualification, hard)
    for name, maker in inspect.getmembers(module, inspect.isfunction)
    if maker.__module__ == module.__name__ and not name.startswith("_")
}
SUCCESS = r"Success: (\d+) m( behind the ring)?(?: at ([\d.]+) of the speed limit, plus (\d) s| within (\d+) s)"


@functools.cache
def case(name, seed):
    return again(name, seed)


def again(name, seed):
    return MISSIONS[name].case(seed, others=OTHERS, vehicle=VEHICLE)


def boxes(found):
    """Everybody at the start, the ego first."""
    start = jax.tree.map(jnp.asarray, found.start)
    ego, them = start.ego, agents.objects(jax.tree.map(jnp.asarray, found.lanes), start.traffic, params=OTHERS)
    own = Objects(
        box_centre(ego, VEHICLE)[None],
        ego.heading[None],
        ego.speed[None],
        jnp.full(1, VEHICLE.length),
        jnp.full(1, VEHICLE.width),
        jnp.ones(1, bool),
    )
    return jax.tree.map(lambda a, b: jnp.concatenate([a, b]), own, them)


def ahead(found):
    """Of the valid vehicles: gap before the ego's bumper [m], sideways [m], speed [m/s]."""
    every = jax.tree.map(np.asarray, boxes(found))
    there = every.valid[1:]
    step = (every.position[1:] - every.position[0])[there]
    cos, sin = np.cos(every.heading[0]), np.sin(every.heading[0])
    along, across = step @ np.array([cos, sin]), step @ np.array([-sin, cos])
    return along - VEHICLE.length / 2 - every.length[1:][there] / 2, across, every.speed[1:][there]


@pytest.mark.parametrize("name", MISSIONS)
def test_a_seed_is_a_drive(name):
    found = [case(name, seed) for seed in SEEDS]
    for one, other in zip(jax.tree.leaves(found[0]), jax.tree.leaves(again(name, 0)), strict=True):
        np.testing.assert_array_equal(one, other)
    assert len({float(one.start.ego.speed) for one in found}) == len(found)
    assert len({float(one.corridor.speed_limit[0]) for one in found}) > 1
    for one in found:
        assert float(one.goal) < float(one.corridor.length)
        assert 0 < float(one.limit) <= LONGEST
        ego = one.start.ego
        assert 0 < float(ego.speed) <= float(one.corridor.speed_limit[40])
        assert not np.asarray(overlaps(boxes(one))).any()
        asks_for_what_its_docstring_says(name, one)
        has_its_road(name, one)
    if ROADS[name] == ROADS["overtake"]:
        assert any(lanes(one)[0] > 2 or np.abs(one.corridor.curvature[:150]).max() > 1e-3 for one in found)


def asks_for_what_its_docstring_says(name, found):
    way, ring, pace, slack, most = re.search(SUCCESS, MAKERS[name].__doc__).groups()
    first, beyond = START + VEHICLE.centre_offset, float(found.goal) - float(way)
    if ring:
        inside = on_junctions(found)
        assert inside[round(beyond)]
        assert not inside[round(beyond) + 1 : round(float(found.corridor.length))].any()
    else:
        assert beyond == pytest.approx(first, abs=1e-3)
    speed = float(found.corridor.speed_limit[round(START)])
    limit = float(most) if most else min(float(way) / (float(pace) * speed) + float(slack), LONGEST)
    assert float(found.limit) == pytest.approx(limit, rel=1e-5)


def has_its_road(name, found):
    own, against, crosses = ROADS[name]
    there = lanes(found)
    assert there[0] in own
    assert there[1] in against
    assert crosses in (None, on_junctions(found)[round(START) : round(float(found.goal))].any())
    assert found.corridor.has_stop.any() == (name.startswith("signal_") or name == "district")
    if name in ("oncoming_overtake", "double_parked"):
        assert found.corridor.change[round(START), 2]  # that lane may be used to overtake


def lanes(found):
    """How many there are in the ego's direction where it starts, and against it."""
    has, against = (x[round(START)] for x in (found.corridor.has_lane, found.corridor.oncoming))
    return (has & ~against).sum(), (has & against).sum()


def on_junctions(found):
    """At which stations the route does."""
    return found.lanes.graph.road_type[found.corridor.lane_link[:, found.corridor.route_lane]] == RoadType.JUNCTION


def test_a_mission_is_made_by_the_function_of_its_name():
    assert MAKERS.keys() == MISSIONS.keys() == ROADS.keys()
    for name, maker in MAKERS.items():
        made = maker()
        assert isinstance(made, Mission)
        assert (made.name, made.number, made.way, made.pace) == (
            name,
            MISSIONS[name].number,
            MISSIONS[name].way,
            MISSIONS[name].pace,
        )


@pytest.mark.parametrize("name", ["unsignalised", "signal_straight", "signal_left", "signal_right", "roundabout"])
def test_others_come_from_other_legs_and_can_stop(name):
    count = 0
    for found in (case(name, seed) for seed in SEEDS):
        them, graph = found.start.traffic, found.lanes.graph
        link, count = them.link[them.valid], count + them.valid.sum()
        assert not (graph.road_type[link] == RoadType.JUNCTION).any()
        assert found.start.ego_link not in link
        room = graph.length[link] - them.station[them.valid] - them.length[them.valid] / 2
        assert (them.speed[them.valid] ** 2 / (2 * COMFORT) < room).all()
    assert count >= 3


def test_missions_share_a_program():
    def shape(found):
        return jax.tree.structure(found), [(np.shape(x), np.asarray(x).dtype) for x in jax.tree.leaves(found)]

    same = [shape(case(name, 3)) for name in MISSIONS if MISSIONS[name].size == StageSize()]
    assert all(one == same[0] for one in same)
    assert len(same) == len(MISSIONS) - 2
    assert len(QUALIFICATION) == 8
    assert len({mission.number for mission in (*QUALIFICATION, *HARD)}) == len(MISSIONS)


@pytest.mark.parametrize("seed", SEEDS)
def test_overtake(seed):
    gap, across, speed = ahead(case("overtake", seed))
    leader = np.argmin(np.where((np.abs(across) < 1) & (gap > 0), gap, np.inf))
    assert 14 < gap[leader] < 41
    assert speed[leader] <= 4


@pytest.mark.parametrize("seed", SEEDS)
def test_cut_in(seed):
    found = case("cut_in", seed)
    traffic = found.start.traffic
    k = int(np.argmax(traffic.valid & (traffic.moved < 1)))
    assert traffic.moved[k] == 0
    assert traffic.offset_to[k] == 0
    assert abs(abs(traffic.offset[k]) - found.corridor.lane_width[60, 2]) < 0.3
    assert traffic.link[k] in found.corridor.lane_link[:, 2]


@pytest.mark.parametrize("seed", SEEDS)
def test_narrow_passage(seed):
    gap, across, speed = ahead(case("narrow_passage", seed))
    assert np.all(speed == 0)
    first = np.argsort(gap)[:2]
    room = np.abs(np.diff(across[first]))[0] - OTHERS.vehicle_width
    assert VEHICLE.width + 0.65 < room < VEHICLE.width + 1.55


@pytest.mark.parametrize("seed", SEEDS)
def test_accident_vehicle(seed):
    found = case("accident_vehicle", seed)
    gap, _, speed = ahead(found)
    standing = speed == 0
    assert 1 <= standing.sum() <= 2
    assert gap[standing].min() > 40


@pytest.mark.parametrize(
    ("name", "turn"), [("signal_straight", Turn.STRAIGHT), ("signal_left", Turn.LEFT), ("signal_right", Turn.RIGHT)]
)
@pytest.mark.parametrize("seed", SEEDS)
def test_signals(name, turn, seed):
    found = case(name, seed)
    inside = np.isin(found.corridor.turn, [turn])
    row = slice(0, round(float(found.goal)))
    assert found.corridor.has_stop.any()
    assert (turn == Turn.STRAIGHT and (found.corridor.turn[row] == turn).all()) or inside[row].any()
    begin = found.start.signals.offset
    assert abs(begin[1] - begin[0]) == pytest.approx(float(found.start.signals.cycle[0]) / 2, rel=1e-4)
    assert found.start.traffic.valid.sum() <= 12


@pytest.mark.parametrize("seed", SEEDS)
def test_unsignalised(seed):
    found = case("unsignalised", seed)
    graph = found.lanes.graph
    assert not found.corridor.has_stop.any()
    assert graph.rule[found.start.ego_link] == Rule.YIELD


def test_hard_missions():
    for seed in SEEDS:
        crowd = case("congestion", seed).start.traffic
        limit = case("congestion", seed).lanes.graph.speed_limit[crowd.link]
        assert crowd.valid.sum() >= 7
        assert np.all((crowd.desired_speed * limit)[crowd.valid] <= 5.01)
        drop = case("lane_drop", seed)
        assert drop.lanes.ends[drop.start.ego_link]
        assert drop.start.traffic.valid.sum() >= 1
        oncoming = case("oncoming_overtake", seed)
        facing = np.asarray(boxes(oncoming).heading)[1:][oncoming.start.traffic.valid]
        assert 1 <= (np.cos(facing) < 0).sum() <= 3
        assert (np.cos(facing) > 0).sum() == 1
        parked = ahead(case("double_parked", seed))
        assert (parked[2] == 0).sum() >= 1
        tight = case("tight_right", seed)
        assert not tight.start.traffic.valid.any()
        assert 0.08 < -float(tight.corridor.curvature[: round(float(tight.goal))].min()) < 0.4
        ring = case("roundabout", seed)
        graph = ring.lanes.graph
        driven = np.unique(ring.corridor.lane_link[: int(ring.corridor.length), 2])
        assert (graph.road_type[driven] == RoadType.JUNCTION).sum() in (3, 5, 7)
        walk = case("pedestrian", seed).start.replay
        assert walk.kind[0] == RoadUser.PEDESTRIAN
        way = np.asarray(walk.position[:, 0])
        assert np.linalg.norm(way[-1] - way[0]) > 9
        assert 1.1 < float(walk.speed.max()) < 2.1
    assert any(case("pedestrian", seed).start.traffic.valid.any() for seed in SEEDS)


@pytest.mark.parametrize("seed", SEEDS)
def test_district(seed):
    found = case("district", seed)
    traffic, graph = found.start.traffic, found.lanes.graph
    assert traffic.valid.all()
    assert traffic.changes.all()
    assert len(set(np.round(traffic.headway, 6))) == len(set(np.round(traffic.desired_speed, 6))) == 32
    assert not (graph.road_type[traffic.link] == RoadType.JUNCTION).any()
    position = np.asarray(boxes(found).position)
    away = np.linalg.norm(position[1:] - position[:1], axis=1)
    assert 12 < away.min() < away.max() < 170
    assert len(set(np.round(found.start.signals.offset, 3))) == 2
