import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.numerics.soft import Relaxation
from urbanjax.roadmap.builders import two_way
from urbanjax.roadmap.locate import follow
from urbanjax.sim import agents, reaction
from urbanjax.sim import lanes as roads
from urbanjax.sim import world as worlds
from urbanjax.types import Command, VehicleState, as_arrays
from urbanjax.vehicle.model import box_centre

HARD, SOFT = Relaxation(), Relaxation(temperature=0.1, mode="soft")


@jax.jit
def _braking(lanes, params, traffic, ego, link, relaxation):
    centre = box_centre(ego, params.vehicle)
    seen = reaction.presence(
        lanes,
        follow(lanes.graph, link, ways=lanes.ways, position=centre, heading=ego.heading, params=params.locate),
        ego=ego,
        vehicle=params.vehicle,
        params=params.reaction,
    )
    chain = agents.chain_of(lanes, traffic, params=params.traffic)
    return reaction.braking(
        seen, traffic, chain=chain, params=params.traffic, reaction=params.reaction, relaxation=relaxation
    )[0]


def braking(road, vehicle, x, y, speed, heading=0.0, lanes=None, relaxation=HARD, params=None, link=1):
    """Braking of one vehicle towards the ego [m/s^2]; x of the ego's rear axle."""
    traffic = road.traffic(vehicle, dtype=jnp.asarray(x).dtype)
    position = jnp.stack([jnp.asarray(x), jnp.asarray(y)])
    ego = VehicleState(position, *(jnp.asarray(v) for v in (heading, speed, 0.0, 0.0)))
    link = jnp.asarray(link, jnp.int32)
    return _braking(lanes or road.lanes, params or road.params, traffic, ego, link, relaxation)


BEHIND = {"x": 100.0, "lane": 1, "speed": 10.0}


def test_traffic_stops_behind_a_standing_ego(road):
    states = road.roll(road.world(road.traffic(BEHIND), ego_x=160.0), 150)
    gap = 160.0 - 0.95 - float(states[-1].traffic.station[0]) - 2.25
    assert 0.5 < gap < 3.0
    assert states[-1].traffic.speed[0] < 0.1


@pytest.mark.parametrize(
    ("y", "heading", "reacts"),
    [(0.0, 0.0, True), (3.5, 0.0, False), (2.0, 0.0, True), (2.9, -0.3, True), (2.9, 0.3, False)],
)
def test_ego_counts_when_it_is_in_the_lane_or_entering_it(road, y, heading, reacts):
    found = braking(road, BEHIND, 120.0, y, 5.0, heading, link=0)
    assert bool(found > 0.5) == reacts


def test_ego_behind_or_alongside_is_no_reason_to_brake(road):
    assert braking(road, BEHIND, 60.0, 0.0, 14.0) < 1e-6
    assert braking(road, BEHIND, 98.0, 3.5, 14.0, link=0) < 1e-6


def test_oncoming_traffic_brakes_for_an_ego_in_its_lane_only_if_told_to(road):
    graph = two_way(1, 1, length=1000.0)
    lanes = roads.from_graph(graph)
    own, oncoming = 0, 1
    assert bool(graph.has_opposite[own, 0])
    params = road.params

    station = float(graph.length[oncoming]) - 560.0

    @jax.jit
    def first_step(y, params):
        traffic = road.traffic({"x": 0.0, "lane": 1, "speed": 10.0})
        traffic = traffic.replace(station=traffic.station.at[0].set(station), link=traffic.link.at[0].set(oncoming))
        world = road.world(traffic, ego_x=500.0, ego_speed=10.0, ego_link=own)
        world = world.replace(ego=world.ego.replace(position=jnp.stack([jnp.asarray(500.0), y])))
        still = Command(jnp.asarray(0.0), jnp.asarray(0.0))
        return worlds.step(params.replace(lane_changes=False), lanes, world, still, 0.1).traffic.acceleration[0]

    def run(y, params):
        return float(first_step(jnp.asarray(y), params))

    free = run(0.0, params)
    assert free > 0
    assert run(3.5, params) < -1
    ignoring = params.replace(traffic=params.traffic.replace(reacts_to_oncoming=False))
    assert np.isclose(run(3.5, ignoring), free)


def test_hard_is_the_limit_of_soft(road):
    for x, y in ((130.0, 0.3), (160.0, 1.8), (125.0, 3.4), (90.0, 0.0)):
        hard = braking(road, BEHIND, x, y, 6.0)
        soft = braking(road, BEHIND, x, y, 6.0, relaxation=Relaxation(1e-3, "soft"))
        np.testing.assert_allclose(soft, hard, atol=1e-3)


def test_gradient_matches_differences(road):
    with jax.enable_x64(True):
        lanes, params = as_arrays(road.lanes, jnp.float64), as_arrays(road.params, jnp.float64)

        @jax.jit
        def value(x):
            return braking(road, BEHIND, x[0], x[1], x[2], x[3], lanes, SOFT, params)

        for start in ([122.0, 1.0, 6.0, 0.05], [247.5, 2.45, 6.0, -0.1], [106.0, 2.6, 9.0, -0.1]):
            start = jnp.asarray(start)
            size = 1e-6
            gradient = jax.grad(value)(start)
            differences = [(value(start + size * e) - value(start - size * e)) / (2 * size) for e in jnp.eye(4)]
            np.testing.assert_allclose(gradient, differences, rtol=1e-5, atol=1e-8)
            assert np.all(np.abs(gradient) > 1e-9)
