import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.evaluation import metrics
from urbanjax.roadmap.builders import intersection, merge
from urbanjax.roadmap.builders.specs import RoadStyle
from urbanjax.sim import agents
from urbanjax.sim import lanes as roads
from urbanjax.sim.signals import SignalProgram

LEG = 80.0


def always(green):
    """A program in which each signal stays as given: green (True) or red."""
    shares = jnp.asarray(np.where(green, 1.0, 0.0), jnp.float32)
    ones = jnp.ones_like(shares)
    return SignalProgram(1e6 * ones, 0 * ones, shares, 0 * ones)


@pytest.fixture(scope="module")
def crossing():
    graph = intersection(signalised=True, n_lanes=1, leg=LEG)
    return roads.from_graph(graph)


@pytest.fixture(scope="module")
def unsignalised():
    graph = intersection(signalised=False, n_lanes=1, leg=LEG)
    return roads.from_graph(graph)


def straight_choice(lanes, link):
    """Route choice that goes straight on from an approach."""
    following = np.asarray(lanes.successor[link])[: int(lanes.n_successors[link])]
    return next(i for i, j in enumerate(following) if int(lanes.graph.turn[j]) == 0)


def approach(lanes, name):
    """Link that comes from the west, south, east or north."""
    area = lanes.graph.area_names.index(f"{name} in")
    return int(np.flatnonzero(np.asarray(lanes.graph.area) == area)[0])


def put(road, lanes, *vehicles):
    """Traffic from dicts with the approach's name, and way to the end of the approach."""
    rows = []
    for vehicle in vehicles:
        link = approach(lanes, vehicle["from"])
        station = float(lanes.graph.length[link]) - vehicle["before"]
        rows.append({"x": 0.0, "lane": 0, "route": straight_choice(lanes, link), "at": (link, station)} | vehicle)
    traffic = road.traffic(*[{k: v for k, v in row.items() if k not in ("from", "before", "at")} for row in rows])
    for i, row in enumerate(rows):
        link, station = row["at"]
        traffic = traffic.replace(link=traffic.link.at[i].set(link), station=traffic.station.at[i].set(station))
    return traffic


def test_stops_before_a_red_signal_and_goes_when_it_turns_green(road, crossing):
    world = road.world(put(road, crossing, {"from": "west", "before": 60.0, "speed": 12.0}))
    world = world.replace(signals=always([False] * 4))
    states = road.roll(world, 150, lanes=crossing)
    link = int(world.traffic.link[0])
    stop = float(crossing.graph.stop_line[link, 0])
    assert int(states[-1].traffic.link[0]) == link
    front = float(states[-1].traffic.station[0]) + 2.25
    assert stop - 4.0 < front < stop
    assert states[-1].traffic.speed[0] < 0.1
    states = road.roll(states[-1].replace(signals=always([True] * 4)), 60, lanes=crossing)
    assert int(states[-1].traffic.link[0]) != link


def test_second_in_the_queue_stops_behind_the_first(road, crossing):
    two = put(
        road, crossing, {"from": "west", "before": 40.0, "speed": 9.0}, {"from": "west", "before": 58.0, "speed": 9.0}
    )
    states = road.roll(road.world(two).replace(signals=always([False] * 4)), 150, lanes=crossing)
    gap = float(states[-1].traffic.station[0] - states[-1].traffic.station[1]) - 4.5
    assert 1.0 < gap < 3.5


def test_yellow_is_passed_when_too_near_to_stop(road, crossing):
    ones = jnp.ones(4)
    yellow = SignalProgram(1e6 * ones, 0 * ones, 0 * ones, 1e6 * ones)
    near = put(road, crossing, {"from": "west", "before": 15.0, "speed": 12.0})
    far = put(road, crossing, {"from": "west", "before": 60.0, "speed": 12.0})
    assert road.roll(road.world(near).replace(signals=yellow), 40, lanes=crossing)[-1].traffic.speed[0] > 8
    assert road.roll(road.world(far).replace(signals=yellow), 120, lanes=crossing)[-1].traffic.speed[0] < 0.2


@pytest.mark.parametrize("head_start", [0.0, 4.0])
def test_yielding_road_gives_way_and_nobody_collides(road, unsignalised, head_start):
    major, minor = {"from": "west", "before": 50.0 + head_start}, {"from": "south", "before": 50.0}
    world = road.world(put(road, unsignalised, major | {"speed": 10.0}, minor | {"speed": 10.0}))
    states = road.roll(world, 150, lanes=unsignalised)
    into = []
    for i in range(2):
        start = int(world.traffic.link[i])
        into.append(next(k for k, state in enumerate(states) if int(state.traffic.link[i]) != start))
    assert into[0] < into[1]
    speeds = np.array([state.traffic.speed[1] for state in states[: into[1]]])
    assert speeds.min() < 7
    objects = jax.jit(lambda t: metrics.overlaps(agents.objects(unsignalised, t, params=road.params.traffic)))
    assert not any(bool(objects(state.traffic).any()) for state in states)


def test_waits_for_the_oncoming_before_turning_left(road, crossing):
    link = approach(crossing, "west")
    following = np.asarray(crossing.successor[link])[: int(crossing.n_successors[link])]
    left = next(i for i, j in enumerate(following) if int(crossing.graph.turn[j]) == 1)
    turning = {"from": "west", "before": 30.0, "speed": 8.0, "route": left}
    world = road.world(put(road, crossing, turning, {"from": "east", "before": 45.0, "speed": 10.0}))
    states = road.roll(world.replace(signals=always([True] * 4)), 150, lanes=crossing)
    objects = jax.jit(lambda t: metrics.overlaps(agents.objects(crossing, t, params=road.params.traffic)))
    assert not any(bool(objects(state.traffic).any()) for state in states)
    into = [
        next(k for k, s in enumerate(states) if int(s.traffic.link[i]) != int(world.traffic.link[i])) for i in (0, 1)
    ]
    assert into[1] < into[0]


def test_merges_before_the_lane_ends_or_stops_at_its_end(road):
    graph = merge(n_lanes=1, style=RoadStyle(speed_limit=50 / 3.6))
    lanes = roads.from_graph(graph)
    ramp = int(np.flatnonzero(np.asarray(lanes.ends))[0])
    for may in (True, False):
        traffic = road.traffic({"x": 0.0, "lane": 0, "speed": 12.0, "changes": may})
        traffic = traffic.replace(link=traffic.link.at[0].set(ramp), station=traffic.station.at[0].set(10.0))
        last = road.roll(road.world(traffic), 150, lanes=lanes)[-1].traffic
        assert bool(last.valid[0])
        if may:
            assert last.speed[0] > 10
        else:
            assert int(last.link[0]) == ramp
            assert 0 < float(graph.length[ramp] - last.station[0]) - 2.25 < 4
