import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.geometry.boxes import box, box_gap
from urbanjax.sim import agents
from urbanjax.sim import lanes as roads
from urbanjax.sim import world as worlds
from urbanjax.sim.scenarios import circulate, follow, overtake
from urbanjax.types import Command, as_arrays
from urbanjax.vehicle.model import box_centre
from urbanjax.vehicle.params import VehicleParams

SIM = as_arrays(worlds.SimParams(vehicle=VehicleParams()))


@pytest.fixture(scope="module")
def starts():
    """512 starts of each family on its road."""
    out = {}
    for module, params in ((overtake, overtake.OvertakeParams()), (follow, follow.FollowParams())):
        lanes = roads.from_graph(module.road(params))
        keys = jax.random.split(jax.random.key(0), 512)
        ranges = as_arrays(params)
        sample = jax.jit(
            jax.vmap(lambda key, m=module, p=ranges: m.sample(key, p, vehicle=SIM.vehicle, others=SIM.traffic))
        )
        out[module] = lanes, sample(keys), params
    return out


def ego_gaps(lanes, scenario):
    """Gap of the ego to every vehicle, [512, V]; 1e3 where there is none."""

    def one(world):
        cars = agents.objects(lanes, world.traffic, params=SIM.traffic)
        n = cars.heading.shape[0]
        centre = jnp.broadcast_to(box_centre(world.ego, SIM.vehicle), (n, 2))
        heading, length, width = (
            jnp.full(n, value) for value in (world.ego.heading, SIM.vehicle.length, SIM.vehicle.width)
        )
        ego = box(centre, heading, length=length, width=width)
        found = box_gap(ego, box(cars.position, cars.heading, length=cars.length, width=cars.width))
        return jnp.where(cars.valid, found, 1e3)

    return np.asarray(jax.jit(jax.vmap(one))(scenario.world))


def inside(values, limits):
    values = np.asarray(values)
    assert values.min() >= limits[0] - 1e-3
    assert values.max() <= limits[1] + 1e-3
    assert np.ptp(values) > 0.9 * (limits[1] - limits[0])


def test_overtake_starts_are_as_stated(starts):
    lanes, scenario, params = starts[overtake]
    traffic, gaps = scenario.world.traffic, ego_gaps(lanes, scenario)
    inside(scenario.world.ego.speed, params.ego_speed)
    inside(traffic.speed[:, overtake.LEADER], params.leader_speed)
    inside(gaps[:, overtake.LEADER], params.gap)
    assert 0.42 < np.asarray(scenario.crowded).mean() < 0.58
    np.testing.assert_array_equal(traffic.valid[:, overtake.BESIDE], scenario.crowded)
    assert np.all(np.asarray(traffic.link[:, overtake.BESIDE]) == overtake.LEFT)
    assert not bool(traffic.valid[:, 2:].any())
    assert gaps.min() > 0.5
    places = np.asarray(traffic.station[:, overtake.BESIDE])
    assert places.min() > 0
    behind = places < params.start
    assert 0.4 < behind.mean() < 0.6


def test_follow_starts_are_as_stated(starts):
    lanes, scenario, params = starts[follow]
    gaps = ego_gaps(lanes, scenario)
    inside(gaps[:, follow.LEADER], params.gap)
    inside(scenario.world.traffic.speed[:, follow.LEADER], params.leader_speed)
    stops = np.asarray(scenario.world.traffic.valid[:, follow.STANDING])
    assert 0.42 < stops.mean() < 0.58
    assert np.all(np.asarray(scenario.world.traffic.speed[:, follow.STANDING]) == 0)


def test_leader_keeps_its_speed_even_with_the_ego_before_it(starts):
    lanes, scenario, _ = starts[overtake]
    world = jax.tree.map(lambda x: x[0], scenario.world)
    speed = float(world.traffic.speed[overtake.LEADER])
    ahead = float(world.traffic.station[overtake.LEADER]) + 6.0
    world = world.replace(ego=world.ego.replace(position=jnp.asarray([ahead, 0.0]), speed=jnp.asarray(speed)))
    step = jax.jit(worlds.step)
    for _ in range(20):
        world = step(SIM.replace(lane_changes=False), lanes, world, Command(jnp.asarray(0.0), jnp.asarray(0.0)), 0.1)
    np.testing.assert_allclose(world.traffic.speed[overtake.LEADER], speed, rtol=1e-5)


def test_equal_keys_give_equal_starts(starts):
    params = overtake.OvertakeParams()
    key = jax.random.split(jax.random.key(0), 512)[7]
    again = overtake.sample(key, params, vehicle=VehicleParams(), others=worlds.SimParams().traffic)
    stored = jax.tree.map(lambda x: x[7], starts[overtake][1])
    for a, b in zip(jax.tree.leaves(again), jax.tree.leaves(stored), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-5)


def test_circulating_traffic_starts_apart_on_the_open_road():
    params = circulate.CirculateParams()
    lanes = roads.from_graph(circulate.road(params))
    scenario = jax.jit(lambda key: circulate.sample(key, params, others=SIM.traffic, lanes=lanes))(jax.random.key(1))
    traffic = scenario.world.traffic
    assert bool(traffic.valid.all())
    assert traffic.link.shape == (params.n_vehicles,)
    link, station = np.asarray(traffic.link), np.asarray(traffic.station)
    assert len(np.unique(link)) > 15
    for i in np.unique(link):
        there = np.sort(station[link == i])
        assert np.all(np.diff(there) > params.spacing - 1e-3)
    batch = jax.tree.map(lambda x: x[None], scenario)
    assert ego_gaps(lanes, batch).min() > 2
