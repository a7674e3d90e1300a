"""Eq. 12 for many goals at once: equal to scipy's Dijkstra, whatever the shape of the network."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.roadmap.oracle import host, oracle
from urbanjax.roadmap import builders
from urbanjax.roadmap.costs_to_go import GOALS, cost_to_go, costs_to_go
from urbanjax.roadmap.padding import GraphSize, pad
from urbanjax.roadmap.route import RouteParams

costs_to_go_jit = jax.jit(costs_to_go, static_argnames="changes")
GRAPHS = [(seed, chains) for seed in range(15) for chains in (False, True)]


@pytest.mark.parametrize("cost", ["length", "time"])
def test_costs_equal_dijkstra_on_random_graphs(random_graph, cost):
    params, goals = RouteParams(cost=cost), jnp.arange(22)
    for seed, chains in GRAPHS:
        graph = random_graph(seed, chains)
        blocked = np.random.default_rng(seed).choice(22, 3, replace=False)
        for closed in ((), blocked):
            found = costs_to_go_jit(
                graph, goals, params=params, blocked=jnp.isin(jnp.arange(24), np.array(closed, int))
            )
            np.testing.assert_allclose(found, oracle(graph, goals, params, blocked=closed), rtol=1e-5)


def test_lexicographic_costs_are_those_of_the_fewest_changes(random_graph):
    goals, pair = jnp.arange(22), RouteParams(change_length=1e5)
    for seed, chains in GRAPHS[:12]:
        graph = random_graph(seed, chains)
        found = costs_to_go_jit(graph, goals, params=RouteParams(search="lexicographic"))
        both = oracle(graph, goals, pair)
        changes = np.floor(both / 1e5)
        least = np.where(np.isfinite(both), both - 1e5 * np.where(np.isfinite(both), changes, 0), np.inf)
        np.testing.assert_allclose(found, least, rtol=1e-5)


def test_without_lane_changes_only_successors_lead_on(random_graph):
    graph, goals = random_graph(7), jnp.arange(22)
    found = costs_to_go_jit(graph, goals, params=RouteParams(), changes=False)
    np.testing.assert_allclose(found, oracle(graph, goals, RouteParams(), changes=False), rtol=1e-5)


def test_more_goals_than_are_relaxed_at_once_on_the_district(district):
    goals = jnp.arange(GOALS + 44) % len(district.length)
    found = costs_to_go_jit(district, goals, params=RouteParams())
    assert len(goals) > GOALS
    np.testing.assert_allclose(found, oracle(host(district), np.asarray(goals), RouteParams()), rtol=1e-5)
    one = jax.jit(cost_to_go)(district, 33, params=RouteParams())
    np.testing.assert_allclose(one, found[33], rtol=1e-6)


def ring(n, n_links=None):
    angle = 2 * np.pi * np.arange(n + 1) / n
    corner = 100 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    lanes = [builders.LaneSpec(str(i), corner[i : i + 2], successors=(str((i + 1) % n),)) for i in range(n)]
    graph = builders.assemble(lanes, n_points=4, gap_tolerance=1.0)
    return pad(graph, size=GraphSize(n_links=n_links))


def test_a_circle_without_any_branch(x64):
    graph = ring(12, n_links=16)
    side = float(graph.length[0])
    found = np.asarray(jax.jit(costs_to_go)(graph, jnp.arange(12)))[:, :12]
    behind = (np.arange(12)[:, None] - np.arange(12)[None, :]) % 12
    np.testing.assert_allclose(found, (behind + 1) * side, rtol=1e-6)
    closed = np.asarray(jax.jit(costs_to_go)(graph, jnp.arange(12), blocked=jnp.arange(16) == 5))[:, :12]
    passes = (5 - np.arange(12)[None, :]) % 12 <= behind
    np.testing.assert_allclose(closed, np.where(passes, np.inf, (behind + 1) * side), rtol=1e-6)


def test_costs_obey_the_triangle_and_fall_along_the_way(district):
    params = RouteParams()
    goals = jnp.arange(len(district.length))
    to = np.asarray(costs_to_go_jit(district, goals, params=params), float)
    graph = host(district)
    for i, j in zip(*np.nonzero(graph.has_successor), strict=True):
        then = graph.successor[i, j]
        reached = np.isfinite(to[:, then]) & (np.asarray(goals) != i)
        assert np.all(to[reached, i] <= (graph.length[i] + to[reached, then]) * (1 + 1e-6))


def test_padding_of_the_graph_changes_nothing(random_graph):
    graph, goals = random_graph(3, True), jnp.arange(22)
    wide = pad(jax.tree.map(jnp.asarray, graph), size=GraphSize(n_links=40, n_successors=5))
    plain, padded = (partial(costs_to_go_jit, goals=goals, params=RouteParams())(g) for g in (graph, wide))
    np.testing.assert_allclose(padded[:, :24], plain, rtol=1e-6)
    assert np.all(np.isinf(padded[:, 24:]))


def test_negative_penalty_does_not_run_for_ever(road):
    assert np.all(np.isfinite(jax.jit(cost_to_go)(road, 5, params=RouteParams(change_length=-1.0))))
