"""A start on a straight road, put on the district: the same situation, seen from its new place."""

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.roadmap.builders import district
from urbanjax.sim import agents, world
from urbanjax.sim import lanes as tables
from urbanjax.sim.scenarios import overtake
from urbanjax.sim.scenarios.overtake import OvertakeParams
from urbanjax.sim.scenarios.transplant import transplant
from urbanjax.sim.world import SimParams
from urbanjax.types import as_arrays
from urbanjax.vehicle.params import VehicleParams

LINK = 82


def test_everybody_keeps_place_relative_to_the_ego():
    graph = district()
    lanes, straight = tables.from_graph(graph), tables.from_graph(overtake.road(OvertakeParams()))
    family, params = as_arrays((OvertakeParams(crowded=1.0), SimParams(vehicle=VehicleParams())))
    start = overtake.sample(jax.random.key(3), family, vehicle=params.vehicle, others=params.traffic)
    moved = jax.jit(transplant)(start, lanes, link=jnp.asarray(LINK), shift=-30.0)
    before = agents.objects(straight, start.world.traffic, params=params.traffic)
    after = agents.objects(lanes, moved.world.traffic, params=params.traffic)
    back = start.world.ego.pose @ moved.world.ego.pose.inverse()
    there = np.asarray(before.valid)
    seen = jax.vmap(back.apply)(after.position)
    assert there.sum() == 2
    np.testing.assert_allclose(seen[there], before.position[there], atol=0.05)
    np.testing.assert_allclose(moved.world.traffic.speed, start.world.traffic.speed)
    assert int(moved.start_link) == LINK
    shown = world.observe(params, lanes, world=moved.world)
    assert shown.signals.state.shape == (graph.n_signals,)
