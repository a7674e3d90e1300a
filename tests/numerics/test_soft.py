import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from urbanjax.numerics import soft
from urbanjax.numerics.soft import Relaxation
from urbanjax.types import ConfigError

HARD, SOFT, THROUGH = Relaxation(), Relaxation(0.3, "soft"), Relaxation(0.3, "straight_through")
COLD = Relaxation(1e-4, "soft")
COST = np.array([2.0, 0.5, 1.5, 0.8])
MODES = pytest.mark.parametrize("mode", soft.MODES)

choose = jax.jit(soft.choose)
minimum = jax.jit(soft.minimum)


def central(function, x, eps=1e-6):
    steps = np.eye(x.size) * eps
    return np.array([(function(jnp.asarray(x + h)) - function(jnp.asarray(x - h))) / (2 * eps) for h in steps])


def test_hard_choice_is_one_hot_on_the_first_minimum():
    np.testing.assert_array_equal(soft.choose(jnp.array([3.0, 1.0, 1.0]), HARD), [0, 1, 0])


@MODES
def test_weights_sum_to_one_and_masked_candidates_get_none(mode):
    mask = jnp.array([True, False, True, True])
    weights = soft.choose(jnp.asarray(COST), Relaxation(0.3, mode), mask=mask)
    assert weights[1] == 0
    np.testing.assert_allclose(weights.sum(), 1, rtol=1e-6)
    assert jnp.argmax(weights) == 3


@MODES
@pytest.mark.parametrize("function", [soft.choose, soft.minimum])
def test_nothing_allowed_is_finite_in_value_and_gradient(mode, function):
    def value(cost):
        return jnp.sum(function(cost, Relaxation(0.3, mode), mask=jnp.zeros(4, bool)))

    assert np.isfinite(value(jnp.asarray(COST)))
    assert np.isfinite(jax.grad(value)(jnp.asarray(COST))).all()


def test_soft_choice_is_the_softmin(x64):
    weights = soft.choose(jnp.asarray(COST), SOFT, scale=2.0)
    expected = np.exp(-COST / 0.6) / np.exp(-COST / 0.6).sum()
    np.testing.assert_allclose(weights, expected, rtol=1e-12)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(-50, 50), min_size=5, max_size=5, unique=True))
def test_cold_choice_and_minimum_are_the_hard_ones_away_from_ties(costs):
    cost = jnp.asarray(costs, float)
    np.testing.assert_allclose(choose(cost, COLD), choose(cost, HARD), atol=1e-6)
    np.testing.assert_allclose(minimum(cost, COLD), min(costs), atol=1e-3)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(-5, 5, width=32), min_size=5, max_size=5))
def test_soft_minimum_lies_within_t_log_n_below_the_hard_one(costs):
    cost = jnp.asarray(costs, float)
    lower, hard = float(minimum(cost, SOFT)), float(minimum(cost, HARD))
    assert hard - 0.3 * np.log(5) - 1e-5 <= lower <= hard + 1e-5


def test_soft_minimum_reaches_its_lower_bound_on_a_tie():
    np.testing.assert_allclose(soft.minimum(jnp.full(8, 2.0), SOFT), 2 - 0.3 * np.log(8), rtol=1e-6)


def test_masked_entries_do_not_pull_the_minimum():
    mask = jnp.array([True, False, True, False])
    values = jnp.asarray(COST)
    assert soft.minimum(values, HARD, mask=mask) == 1.5
    np.testing.assert_allclose(soft.minimum(values, SOFT, mask=mask), soft.minimum(values[::2], SOFT), rtol=1e-6)
    assert soft.minimum(values, HARD, mask=jnp.zeros(4, bool), fill=9.0) == 9


@pytest.mark.parametrize(
    "function",
    [
        lambda x, r: soft.choose(x, r) @ jnp.arange(4.0),
        lambda x, r: soft.minimum(x, r, scale=2.0),
        lambda x, r: soft.above(x, 0.9, r, scale=0.5) @ jnp.arange(1.0, 5.0),
    ],
    ids=["choose", "minimum", "above"],
)
def test_gradients_of_the_three_modes(x64, function):
    x = jnp.asarray(COST)
    soft_slope = jax.grad(function)(x, SOFT)
    np.testing.assert_allclose(soft_slope, central(lambda x: function(x, SOFT), COST), rtol=1e-6, atol=1e-9)
    assert np.abs(soft_slope).max() > 1e-3
    assert function(x, THROUGH) == function(x, HARD)
    np.testing.assert_array_equal(jax.grad(function)(x, THROUGH), soft_slope)


@pytest.mark.parametrize("function", [soft.choose, soft.minimum])
def test_gradient_by_the_temperature_is_finite_beside_masked_candidates(x64, function):
    mask = jnp.array([True, False, True, True])

    def value(t):
        return jnp.sin(function(jnp.asarray(COST), Relaxation(t, "soft"), mask=mask)).sum()

    step = 1e-6
    np.testing.assert_allclose(jax.grad(value)(0.3), (value(0.3 + step) - value(0.3 - step)) / (2 * step), rtol=1e-6)


def test_hard_decisions_pass_no_gradient():
    assert not jax.grad(lambda x: soft.choose(x, HARD) @ jnp.arange(4.0))(jnp.asarray(COST)).any()
    assert not jax.grad(lambda x: soft.above(x, 0.9, HARD).sum())(jnp.asarray(COST)).any()


def test_hard_minimum_passes_the_gradient_of_its_argument():
    np.testing.assert_array_equal(jax.grad(lambda x: soft.minimum(x, HARD))(jnp.asarray(COST)), [0, 1, 0, 0])


def test_above_is_a_half_at_the_threshold_and_saturates_with_finite_gradient():
    assert soft.above(jnp.asarray(2.0), 2.0, SOFT) == 0.5
    assert soft.above(jnp.asarray(2.0), 2.0, HARD) == 0
    for x in (-1e6, 1e6):
        assert soft.above(jnp.asarray(x), 2.0, SOFT) == (x > 0)
        assert np.isfinite(jax.grad(soft.above)(jnp.asarray(x), 2.0, SOFT))


def test_degrees_follow_boolean_logic_at_the_corners():
    a, b = jnp.array([0.0, 0.0, 1.0, 1.0]), jnp.array([0.0, 1.0, 0.0, 1.0])
    np.testing.assert_array_equal(soft.both(a, b), [0, 0, 0, 1])
    np.testing.assert_array_equal(soft.either(a, b), [0, 1, 1, 1])
    np.testing.assert_array_equal(soft.negate(a), [1, 1, 0, 0])
    np.testing.assert_allclose(
        soft.either(a * 0.3, b * 0.6), soft.negate(soft.both(1 - a * 0.3, 1 - b * 0.6)), atol=1e-6
    )


def test_temperature_is_a_leaf_and_the_mode_is_structure():
    many = jax.vmap(lambda t: soft.minimum(jnp.asarray(COST), Relaxation(t, "soft")))(jnp.array([0.01, 0.1, 1.0]))
    assert (np.diff(many) < 0).all()
    assert jax.tree.structure(HARD) != jax.tree.structure(SOFT)


@pytest.mark.parametrize("function", [soft.choose, soft.minimum, lambda cost, how: soft.above(cost, 0.9, how)])
def test_an_unknown_mode_is_named(function):
    with pytest.raises(ConfigError, match="mode is 'sofft': use one of hard, soft, straight_through"):
        function(jnp.asarray(COST), Relaxation(0.1, "sofft"))
