from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.numerics.soft import Relaxation
from urbanjax.planning.lattice import search
from urbanjax.planning.lattice.search import layered_search

LAYERS, NODES = 5, 4


@pytest.fixture
def lattice(x64):
    rng = np.random.default_rng(3)
    start, edges = rng.uniform(0, 2, NODES), rng.uniform(0, 2, (LAYERS - 1, NODES, NODES))
    edges[1, :, 2] = 1e4  # a node that nothing should pass
    paths = np.array(list(product(range(NODES), repeat=LAYERS)))
    cost = start[paths[:, 0]] + sum(edges[i, paths[:, i], paths[:, i + 1]] for i in range(LAYERS - 1))
    return jnp.asarray(start), jnp.asarray(edges), paths, cost


def test_hard_search_is_exhaustive_search(lattice):
    start, edges, paths, cost = lattice
    value, nodes, marked = layered_search(start, edges, relaxation=Relaxation())
    best = paths[cost.argmin()]
    np.testing.assert_allclose(value, cost.min(), rtol=1e-14)
    np.testing.assert_array_equal(np.asarray(nodes).argmax(1), best)
    np.testing.assert_array_equal(np.asarray(nodes), np.eye(NODES)[best])
    for i in range(LAYERS - 1):
        assert marked[i, best[i], best[i + 1]] == 1
        assert np.sum(marked[i]) == 1


def test_soft_search_is_the_gibbs_distribution_over_paths(lattice):
    start, edges, paths, cost = lattice
    t = 0.3
    value, nodes, _ = layered_search(start, edges, relaxation=Relaxation(0.3, mode="soft"))
    weight = np.exp(-(cost - cost.min()) / t)
    np.testing.assert_allclose(value, cost.min() - t * np.log(weight.sum()), rtol=1e-12)
    weight /= weight.sum()
    expected = np.stack([np.bincount(paths[:, i], weight, NODES) for i in range(LAYERS)])
    np.testing.assert_allclose(nodes, expected, atol=1e-12)


def test_gradient_of_the_soft_value_is_the_marginals(lattice):
    start, edges, _, _ = lattice
    relaxation = Relaxation(0.3, mode="soft")
    of_start, of_edges = jax.grad(lambda s, e: layered_search(s, e, relaxation=relaxation)[0], argnums=(0, 1))(
        start, edges
    )
    _, nodes, marked = layered_search(start, edges, relaxation=relaxation)
    np.testing.assert_allclose(of_start, nodes[0], atol=1e-12)
    np.testing.assert_allclose(of_edges, marked, atol=1e-12)


@pytest.mark.parametrize("temperature", [0.01, 0.1, 1.0, 10.0])
def test_soft_value_is_a_lower_bound_within_t_log_n(lattice, temperature):
    start, edges, paths, cost = lattice
    value, _, _ = layered_search(start, edges, relaxation=Relaxation(temperature, mode="soft"))
    assert cost.min() - temperature * np.log(len(paths)) <= value <= cost.min()


def test_temperature_to_zero_is_the_hard_search(lattice):
    start, edges, _, _ = lattice
    hard = layered_search(start, edges, relaxation=Relaxation())
    cold = layered_search(start, edges, relaxation=Relaxation(1e-3, mode="soft"))
    for a, b in zip(hard, cold, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)


def test_straight_through_has_the_hard_value_and_the_soft_gradient(lattice):
    start, edges, _, _ = lattice

    def offset(relaxation):
        return lambda e: jnp.sum(layered_search(start, e, relaxation=relaxation)[1] @ jnp.arange(4.0))

    value, gradient = jax.value_and_grad(offset(Relaxation(0.3, mode="straight_through")))(edges)
    assert value == offset(Relaxation())(edges)
    assert np.abs(gradient).max() > 1e-2


def test_a_lattice_of_barred_edges_still_has_a_finite_answer():
    def value(cost):
        return layered_search(jnp.full(3, cost), jnp.full((4, 3, 3), cost), relaxation=Relaxation(0.1, mode="soft"))[0]

    assert np.isfinite(value(1e4))
    assert np.isfinite(jax.grad(value)(1e4))


@pytest.mark.parametrize("mode", ["soft", "straight_through"])
def test_the_derivative_by_hand_is_that_of_the_search(mode, x64):
    rng = np.random.default_rng(4)
    arguments = jnp.asarray(rng.normal(size=4)), jnp.asarray(rng.normal(size=(5, 4, 4))), jnp.asarray(0.3)
    weights = [jnp.asarray(rng.normal(size=shape)) for shape in ((), (6, 4), (5, 4, 4))]

    def gradient(function):
        def total(*arguments):
            return sum(jnp.sum(w * x) for w, x in zip(weights, function(*arguments), strict=True))

        return jax.jit(jax.grad(total, argnums=(0, 1, 2)))(*arguments)

    found = gradient(lambda start, edge, t: layered_search(start, edge, relaxation=Relaxation(t, mode), scale=0.7))
    expected = gradient(lambda start, edge, t: search.searched(start, edge, relaxation=Relaxation(0.7 * t, mode))[0])
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)
