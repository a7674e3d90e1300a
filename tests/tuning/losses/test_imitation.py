import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.planning.micro import MICRO_TERMS, MicroWeights
from urbanjax.tuning.losses import imitation
from urbanjax.tuning.losses.imitation import Choices

J, T = 6, 0.8


@pytest.fixture
def some(x64):
    rng = np.random.default_rng(0)
    broken = jnp.zeros(J).at[2].set(1e3)
    error = jnp.asarray(rng.uniform(0.5, 3, (J, 5))).at[2].set(0.1)
    features = jnp.asarray(rng.uniform(0, 1, (J, len(MICRO_TERMS))))
    return Choices(features, broken, jnp.zeros(6), error, jnp.zeros(J))


def test_shares_sum_to_one_and_fall_with_cost(some):
    cost = imitation.costs(some, MicroWeights())
    share = np.exp(imitation.log_probability(cost, T))
    np.testing.assert_allclose(share.sum(), 1, rtol=1e-12)
    np.testing.assert_array_equal(np.argsort(cost), np.argsort(-share))
    expected = np.asarray(some.features) @ [getattr(MicroWeights(), name) for name in MICRO_TERMS]
    np.testing.assert_allclose(np.asarray(cost) - np.asarray(some.broken), expected, rtol=1e-12)


def test_the_driver_is_taken_for_the_nearest_that_breaks_no_limit(some):
    allowed = [j for j in range(J) if j != 2]
    nearest = allowed[np.asarray(some.error)[allowed].mean(axis=1).argmin()]
    assert int(imitation.nearest_candidate(some)) == nearest
    every = some.replace(broken=some.broken + 1e3)  # all break one: the least bad ones count
    assert int(imitation.nearest_candidate(every)) == nearest
    cost = imitation.costs(some, MicroWeights())
    expected = np.asarray(cost)[nearest] / T + np.logaddexp.reduce(-np.asarray(cost) / T)
    np.testing.assert_allclose(imitation.nearest_loss(some, cost, temperature=T), expected, rtol=1e-10)


def test_a_mixture_is_counted_out_and_narrow_ones_ask_for_the_nearest(some):
    cost, spread = imitation.costs(some, MicroWeights()), 0.5
    share = np.exp(imitation.log_probability(cost, T))
    squared = (np.asarray(some.error) ** 2).mean(axis=1)
    density = (share * np.exp(-squared / (2 * spread**2)) / (2 * np.pi * spread**2)).sum()
    found = imitation.driven_loss(some, cost, temperature=T, spread=spread)
    np.testing.assert_allclose(found, -np.log(density), rtol=1e-10)
    expected = (share * np.asarray(some.error)[:, -1]).sum()
    np.testing.assert_allclose(imitation.displacement(some, cost, temperature=T), expected, rtol=1e-10)


def test_gradients_equal_central_differences(some):
    names = ("obstacle", "curvature", "macro")

    def value(x):
        cost = imitation.costs(some, MicroWeights(**dict(zip(names, x[:3], strict=True))))
        driven = imitation.driven_loss(some, cost, temperature=x[3], spread=0.7)
        return driven + imitation.nearest_loss(some, cost, temperature=x[3])

    x, h = jnp.array([1.0, 2.0, 0.5, 0.8]), 1e-6
    numeric = [(value(x.at[i].add(h)) - value(x.at[i].add(-h))) / (2 * h) for i in range(4)]
    np.testing.assert_allclose(jax.grad(value)(x), numeric, rtol=1e-6, atol=1e-8)


def test_scale_and_temperature_are_a_gauge(some):
    cost = imitation.costs(some, MicroWeights())
    one, other = (imitation.nearest_loss(some, cost * k, temperature=T * k) for k in (1.0, 7.0))
    np.testing.assert_allclose(one, other, rtol=1e-12)
