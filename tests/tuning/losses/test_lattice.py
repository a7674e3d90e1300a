from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.planning.lattice.layers import LatticeWeights
from urbanjax.planning.macro import LatticeCosts
from urbanjax.tuning.losses import lattice

LAYERS, NODES, T = 4, 3, 0.7
NAMES = ("obstacle", "curvature", "route", "centre", "forbidden")


@pytest.fixture
def tiny(x64):
    """Terms at weights of 1 on a lattice that can be counted out."""
    rng = np.random.default_rng(1)
    nodes = {name: jnp.asarray(rng.uniform(0, 1, (LAYERS, NODES))) for name in NAMES}
    nodes["forbidden"] = jnp.zeros((LAYERS, NODES)).at[2, 1].set(1e-4)
    start = {"length": jnp.asarray(rng.uniform(0, 1, NODES)), "lane_change": jnp.asarray(rng.uniform(0, 1, NODES))}
    edges = {name: jnp.asarray(rng.uniform(0, 1, (LAYERS - 1, NODES, NODES))) for name in ("length", "lane_change")}
    return LatticeCosts(None, None, None, None, nodes, start, edges, None, None, None)


def cost_of(costs, weights, path):
    def weight(name):
        return 1.0 if name == "length" else float(getattr(weights, name))

    total = sum(weight(name) * float(part[path[0]]) for name, part in costs.start.items())
    total += sum(weight(name) * float(part[i, path[i]]) for name, part in costs.nodes.items() for i in range(LAYERS))
    return total + sum(
        weight(name) * float(part[i, path[i], path[i + 1]])
        for name, part in costs.edges.items()
        for i in range(LAYERS - 1)
    )


PATHS = list(product(range(NODES), repeat=LAYERS))


def log_likelihoods(costs, weights):
    cost = np.array([cost_of(costs, weights, path) for path in PATHS])
    return -cost / T - np.logaddexp.reduce(-cost / T)


def loss(costs, weights, node, reached):
    start, edges = lattice.weighed(costs, weights)
    return lattice.path_loss(
        start, edges, node=jnp.asarray(node, jnp.int32), reached=jnp.asarray(reached), temperature=T
    )


def test_likelihood_is_that_of_counting_all_paths(tiny):
    weights = LatticeWeights(obstacle=1.3, route=0.6)
    whole = [float(loss(tiny, weights, path, [True] * LAYERS)) for path in PATHS]
    np.testing.assert_allclose(whole, -log_likelihoods(tiny, weights), atol=1e-9)
    np.testing.assert_allclose(np.exp(-np.array(whole)).sum(), 1.0, rtol=1e-9)


@pytest.mark.parametrize("reached", [(True, True, False, False), (True, False, True, False), (False,) * 4])
def test_layers_that_are_not_reached_are_summed_over(tiny, reached):
    weights, node = LatticeWeights(), (2, 0, 1, 2)
    alike = [all(not r or p == n for r, p, n in zip(reached, path, node, strict=True)) for path in PATHS]
    expected = -np.logaddexp.reduce(log_likelihoods(tiny, weights)[alike])
    np.testing.assert_allclose(loss(tiny, weights, node, reached), expected, atol=1e-9)


def test_gradient_equals_central_differences(tiny):
    names = ("obstacle", "curvature", "route", "centre", "lane_change")

    def value(x):
        weights = LatticeWeights(**dict(zip(names, x, strict=True)))
        return loss(tiny, weights, (0, 1, 2, 0), (True, True, True, False))

    x, h = jnp.array([1.0, 0.5, 2.0, 0.7, 1.5]), 1e-5
    slope = jax.grad(value)(x)
    numeric = [(value(x.at[i].add(h)) - value(x.at[i].add(-h))) / (2 * h) for i in range(5)]
    np.testing.assert_allclose(slope, numeric, rtol=1e-6, atol=1e-9)
    assert np.abs(slope).min() > 1e-3
