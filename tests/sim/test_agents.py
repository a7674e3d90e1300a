import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.roadmap.builders import curve
from urbanjax.roadmap.builders.specs import RoadStyle
from urbanjax.sim import agents
from urbanjax.sim import lanes as roads
from urbanjax.types import as_arrays

from .conftest import LIMIT, x_of


def test_follower_settles_at_the_equilibrium_gap(road):
    leader = {"x": 60.0, "lane": 1, "speed": 6.0, "desired_speed": 6.0 / LIMIT, "reacts": False}
    states = road.roll(road.world(road.traffic(leader, {"x": 20.0, "lane": 1, "speed": 9.0})), 600)
    x = x_of(states[-1].traffic)
    expected = (2.0 + 6.0 * 1.2) / np.sqrt(1 - (6.0 / LIMIT) ** 4)
    assert np.isclose(x[0] - x[1] - 4.5, expected, atol=0.05)
    assert np.isclose(states[-1].traffic.speed[1], 6.0, atol=0.01)


def test_free_vehicle_reaches_its_wanted_speed(road):
    states = road.roll(road.world(road.traffic({"x": 10.0, "lane": 1, "speed": 3.0, "desired_speed": 0.8})), 400)
    assert np.isclose(states[-1].traffic.speed[0], 0.8 * LIMIT, atol=0.02)


def test_string_behind_a_stopping_leader_does_not_collide(road):
    leader = {"x": 160.0, "lane": 1, "speed": 12.0, "desired_speed": 1e-3, "reacts": False}
    others = [{"x": 145.0 - 18.0 * i, "lane": 1, "speed": 12.0} for i in range(7)]
    states = road.roll(road.world(road.traffic(leader, *others)), 300)
    gaps = np.stack([-np.diff(x_of(state.traffic)) - 4.5 for state in states])
    assert gaps.min() > 0.5
    assert np.all(np.asarray(states[-1].traffic.speed) < 0.1)
    accelerations = np.stack([state.traffic.acceleration for state in states])
    assert accelerations.min() >= -road.params.traffic.max_deceleration - 1e-4


def test_vehicle_that_does_not_react_keeps_its_speed(road):
    fast = {"x": 20.0, "lane": 1, "speed": 9.0, "desired_speed": 9.0 / LIMIT, "reacts": False}
    states = road.roll(road.world(road.traffic(fast, {"x": 30.0, "lane": 1, "desired_speed": 1e-3})), 20)
    np.testing.assert_allclose([state.traffic.speed[0] for state in states], 9.0, atol=1e-4)


def test_vehicle_is_removed_at_the_end_of_the_road(road):
    states = road.roll(road.world(road.traffic({"x": 990.0, "lane": 1, "speed": 10.0})), 15)
    valid = [bool(state.traffic.valid[0]) for state in states]
    assert valid[5]
    assert not valid[-1]


def test_leader_beyond_the_link_is_seen(road):
    leader = {"x": 262.0, "lane": 1, "speed": 0.0, "desired_speed": 1e-3}
    states = road.roll(road.world(road.traffic(leader, {"x": 200.0, "lane": 1, "speed": 10.0})), 150)
    x = x_of(states[-1].traffic)
    assert 0.5 < x[0] - x[1] - 4.5 < 3.0


def test_vehicle_whose_tail_is_on_the_link_behind_is_seen_there(road):
    traffic = road.traffic({"x": 249.0, "lane": 1, "speed": 10.0})
    moved = agents.move(road.lanes, traffic, acceleration=jnp.zeros(8), params=road.params.traffic, dt=0.2)
    assert int(moved.link[0]) == 3
    assert bool(moved.has_other[0])
    assert int(moved.other[0]) == 1
    np.testing.assert_allclose(moved.other_station[0], 251.0, rtol=1e-6)
    gone = agents.move(road.lanes, moved, acceleration=jnp.zeros(8), params=road.params.traffic, dt=0.5)
    assert not bool(gone.has_other[0])


def test_motion_is_continuous_from_link_to_link_in_a_curve():
    graph = curve(radius=40.0, n_lanes=2, lead=40.0, style=RoadStyle(section=30.0))
    lanes = roads.from_graph(graph)
    params = as_arrays(agents.TrafficParams())
    n = graph.length.shape[0]
    first = [i for i in range(n) if not bool(graph.has_predecessor[i].any())]
    road_traffic = _traffic(jnp.asarray(first, jnp.int32), 10.0)

    @jax.jit
    def substep(traffic):
        chain = agents.chain_of(lanes, traffic, params=params)
        wanted = agents.follow(lanes, traffic, chain=chain, braking=jnp.zeros_like(traffic.speed), params=params)
        traffic = agents.move(lanes, traffic, acceleration=wanted, params=params, dt=0.05)
        return traffic, agents.objects(lanes, traffic, params=params)

    places, headings, speeds = [], [], []
    for _ in range(280):
        road_traffic, boxes = substep(road_traffic)
        if not bool(boxes.valid.all()):
            break
        places.append(boxes.position)
        headings.append(boxes.heading)
        speeds.append(boxes.speed)
    places, headings, speeds = np.stack(places), np.unwrap(np.stack(headings), axis=0), np.stack(speeds)
    assert len(places) > 100
    steps = np.linalg.norm(np.diff(places, axis=0), axis=-1)
    np.testing.assert_allclose(steps, 0.05 * speeds[1:], atol=0.01)
    assert np.abs(np.diff(headings, axis=0)).max() < 0.05 * 12 / 36
    assert np.isclose(headings[-1, 0] - headings[0, 0], np.pi / 2, atol=1e-3)
    # Curve speed: no more than the permitted lateral acceleration on the inner lane.
    assert speeds.min() < np.sqrt(2.5 * 42.0)


def _traffic(link, speed):
    like = jnp.ones(link.shape)
    no = jnp.zeros(link.shape, bool)
    floats = {"station": 0 * like + 5, "speed": speed * like, "moved": like, "length": 4.5 * like, "width": 1.9 * like}
    floats |= {"desired_speed": like, "headway": 1.2 * like, "politeness": 0 * like}
    zeros = {name: 0 * like for name in ("offset", "acceleration", "offset_from", "offset_to", "cooldown")}
    return agents.Traffic(
        link=link,
        other=link,
        other_station=0 * like,
        route=0 * link,
        has_other=no,
        changes=no,
        reacts=~no,
        valid=~no,
        **floats,
        **zeros,
    )


def _crowd(road, dtype=None, n=8):
    rng = np.random.default_rng(3)
    vehicles = [
        {"x": 40.0 + 14.0 * i, "lane": i % 2, "speed": float(rng.uniform(4, 12)), "changes": True}
        | {"desired_speed": float(rng.uniform(0.5, 1.1)), "headway": float(rng.uniform(0.9, 1.6))}
        for i in range(6)
    ]
    return road.traffic(*vehicles, n=n, dtype=dtype)


@pytest.mark.parametrize("seed", [0, 1])
def test_order_of_vehicles_does_not_matter(road, seed):
    traffic = _crowd(road)
    order = np.random.default_rng(seed).permutation(8)
    shuffled = jax.tree.map(lambda x: x[order], traffic)
    one = road.roll(road.world(traffic), 80)[-1].traffic
    two = road.roll(road.world(shuffled), 80)[-1].traffic
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(two), strict=True):
        np.testing.assert_allclose(np.asarray(a)[order], b, rtol=1e-6, atol=1e-5)


def test_padding_does_not_matter(road):
    one = road.roll(road.world(_crowd(road)), 60)[-1].traffic
    two = road.roll(road.world(_crowd(road, n=12)), 60)[-1].traffic
    assert float(jnp.max(jnp.abs(one.speed[:6] - 10.0))) > 0.1
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(two), strict=True):
        np.testing.assert_allclose(a[:6], b[:6], rtol=1e-6, atol=1e-5)


def test_batch_equals_single(road):
    with jax.enable_x64(True):
        lanes, params = as_arrays(road.lanes, jnp.float64), as_arrays(road.params, jnp.float64)
        worlds = [road.world(_crowd(road, jnp.float64), ego_x=x, ego_speed=8.0) for x in (0.0, 60.0, 130.0)]
        batch = jax.tree.map(lambda *x: jnp.stack(x), *worlds)
        command = jax.tree.map(jnp.asarray, road_command(jnp.float64))
        many = jax.jit(jax.vmap(lambda w: road.step(params, lanes, w, command, jnp.asarray(0.1))))
        for _ in range(20):
            batch = many(batch)
        for i, world in enumerate(worlds):
            single = road.roll(world, 20, params, lanes, acceleration=0.3)[-1]
            for a, b in zip(jax.tree.leaves(batch), jax.tree.leaves(single), strict=True):
                np.testing.assert_allclose(a[i], b, rtol=0, atol=1e-9)


def road_command(dtype):
    from urbanjax.types import Command

    return Command(jnp.asarray(0.3, dtype), jnp.asarray(0.0, dtype))
