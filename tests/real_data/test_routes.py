"""Eq. 12 on real road networks: 15 to 100 random pairs of links each (slow: 500), equal to scipy's Dijkstra."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.roadmap.oracle import host, oracle, walked_cost
from urbanjax.io import maps
from urbanjax.roadmap import builders
from urbanjax.roadmap.costs_to_go import costs_to_go
from urbanjax.roadmap.padding import GraphSize
from urbanjax.roadmap.route import RouteParams, Trip, plan_route
from urbanjax.types import Status

pytestmark = [pytest.mark.real_data, pytest.mark.filterwarnings("ignore::urbanjax.io.maps.DanglingWarning")]

# Folder, how many maps it holds at least, and how many pairs are drawn on each.
FOLDERS = [
    ("commonroad", 9, 40),
    ("commonroad_recorded", 7, 60),
    ("frenet_examples", 2, 100),
    ("lanelet2", 2, 100),
    ("racetracks", 4, 100),
    ("sumo", 1, 15),
]
TABLES = ("valid", "length", "speed_limit", "successor", "has_successor")
SIDES = tuple(
    f"{kind}{side}{end}" for side in ("left", "right") for kind, end in (("", "_link"), ("has_", ""), ("", "_change"))
)


def plan(graph, start, goal, params):
    return plan_route(graph, start, trip=Trip(goal), params=params)


plan_routes = jax.jit(jax.vmap(plan, (None, 0, 0, None)))
to_go = jax.jit(costs_to_go)


@pytest.fixture(scope="module")
def slim():
    """The connections of a small graph alone, in one shape, so that one program serves them; a large one as it is."""
    lane = builders.LaneSpec("a", np.array([[0.0, 0.0], [10.0, 0.0]]))
    template = builders.assemble([lane], n_points=4, size=GraphSize(n_links=128, n_successors=8))

    def slimmed(graph):
        if len(graph.length) > 128:
            return graph
        more, wider = 128 - len(graph.length), 8 - graph.successor.shape[1]
        padded = {}
        for name in TABLES + SIDES:
            x = np.asarray(getattr(graph, name))
            fill = 1 if name in ("length", "speed_limit") else 0
            padded[name] = jnp.asarray(np.pad(x, ((0, more), (0, wider))[: x.ndim], constant_values=fill))
        return template.replace(**padded)

    return slimmed


@pytest.mark.parametrize(
    ("folder", "least", "pairs"),
    [*FOLDERS, *(pytest.param(folder, least, 500, marks=pytest.mark.slow) for folder, least, _ in FOLDERS)],
)
def test_routes_between_random_links(data_dir, slim, folder, least, pairs):
    files = sorted(file for file in (data_dir / "maps" / folder).iterdir() if "raceline" not in file.name)
    assert len(files) >= least
    for file in files:
        graph = slim(maps.read(file).graph)
        starts, goals = np.random.default_rng(0).choice(np.flatnonzero(graph.valid), (2, pairs))
        for params in (RouteParams(n_links=256), RouteParams(cost="time", n_links=256)):
            best = oracle(host(graph), goals, params)[np.arange(pairs), starts]
            costs = to_go(graph, jnp.asarray(goals, jnp.int32), params=params)[np.arange(pairs), starts]
            np.testing.assert_allclose(costs, best, rtol=1e-5, err_msg=file.name)
            routes = host(plan_routes(graph, starts, goals, params))
            reached = routes.status == Status.OK
            np.testing.assert_array_equal(reached, np.isfinite(best), err_msg=file.name)
            np.testing.assert_allclose(routes.cost[reached], best[reached], rtol=1e-5, err_msg=file.name)
            for k in np.flatnonzero(reached)[:5]:
                route = jax.tree.map(lambda x, k=k: x[k], routes)
                assert walked_cost(host(graph), route, params) == pytest.approx(best[k], rel=1e-5)
