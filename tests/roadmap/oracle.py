"""Dijkstra (scipy, double precision) on the moves that a road graph's tables allow."""

import jax
import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra


def host(graph):
    """The graph with numpy arrays."""
    return jax.tree.map(np.asarray, graph)


def edges(graph, params, changes=True, blocked=()):
    """All moves (from, to, cost) of a graph, from its tables, and what driving each link costs."""
    weight = np.asarray(graph.length if params.cost == "length" else graph.length / graph.speed_limit, float)
    penalty = params.change_length if params.cost == "length" else params.change_time
    valid, barred = np.asarray(graph.valid), np.isin(np.arange(len(weight)), blocked)
    out = []
    for i in np.flatnonzero(valid):
        if not barred[i]:
            out += [(i, j, weight[i]) for j in graph.successor[i][graph.has_successor[i]] if valid[j] and not barred[j]]
        for side in ("left", "right"):
            j = int(getattr(graph, f"{side}_link")[i])
            allowed = getattr(graph, f"has_{side}")[i] and getattr(graph, f"{side}_change")[i]
            if changes and allowed and valid[j] and not barred[j]:
                out.append((i, j, penalty))
    return out, np.where(barred, np.inf, weight)


def oracle(graph, goal, params, changes=True, blocked=()):
    """Cost from the start of each link to the end of the goal (or to the end of each of many goals)."""
    listed, weight = edges(graph, params, changes, blocked)
    cheapest = {}
    for i, j, c in listed:
        if i != j:
            cheapest[j, i] = min(cheapest.get((j, i), np.inf), c)
    rows, columns = np.array(list(cheapest)).reshape(-1, 2).T
    matrix = csr_array((list(cheapest.values()), (rows, columns)), shape=(len(weight), len(weight)))
    return dijkstra(matrix, indices=goal) + np.expand_dims(weight[goal], -1)


def walked_cost(graph, route, params, blocked=()):
    """Cost of the links of a route, checking that each move is one that the graph allows."""
    listed, weight = edges(graph, params, blocked=blocked)
    costs = {}
    for i, j, c in listed:
        costs.setdefault((i, j), []).append(c)
    links = np.asarray(route.link)[np.asarray(route.valid)]
    change = np.asarray(route.change)
    penalty = params.change_length if params.cost == "length" else params.change_time
    total = weight[links[-1]]
    for k in range(len(links) - 1):
        spent = penalty if change[k] else weight[links[k]]
        assert np.min(np.abs(np.array(costs[links[k], links[k + 1]]) - spent)) < 1e-6 * (1 + spent)
        total += spent
    return total


def pairs(table, mask):
    """What a masked table of links relates, as pairs (row, entry)."""
    table, mask = np.asarray(table), np.asarray(mask)
    return {(i, int(table[i, k])) for i, k in zip(*np.nonzero(mask), strict=True)}
