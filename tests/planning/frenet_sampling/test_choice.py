"""The choice among Frenet candidates: hard, soft, and for many scenarios at once."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.planning.frenet_sampling.helpers import (
    WISH,
    cars,
    circular,
    curved,
    driving_of,
    each,
    line_of,
    plan_of,
    scene_params,
    state,
)
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning.frenet_sampling import choice
from urbanjax.planning.frenet_sampling.fan import generate
from urbanjax.planning.frenet_sampling.limits import FRENET_LIMITS


def test_the_choice_is_the_cheapest_that_breaks_no_limit():
    driving = driving_of(scene_params(), Relaxation())

    @jax.jit
    def both(line, begin, prediction):
        plan = choice.plan(line, begin, desired_speed=jnp.asarray(WISH), prediction=prediction, driving=driving)
        return plan, generate(line, begin, grid=driving.params.grid)

    # From one program: two would differ by rounding.
    plan, fan = both(line_of(curved), state(), cars([(28.0, 4.0, 0.5), (0.0, 0.0, 0.0)]))
    feasible = ~np.asarray(plan.reasons).any(axis=0).ravel()
    total = np.asarray(plan.terms).sum(axis=0).ravel()
    assert feasible.any()
    assert not feasible.all()
    assert plan.chosen == np.where(feasible, total, np.inf).argmin()
    assert plan.feasible
    np.testing.assert_allclose(np.asarray(plan.cost).ravel()[feasible], total[feasible], rtol=1e-6)
    np.testing.assert_array_equal(plan.values, each(fan.values)[:, int(plan.chosen)])


def test_where_all_break_a_limit_the_least_bad_is_taken():
    line = line_of(curved, length=11.0)
    plan = plan_of(line)
    assert not plan.feasible
    assert plan.reasons[FRENET_LIMITS.index("reference")].all()
    broken = np.asarray(plan.reasons).sum(axis=0).ravel()
    assert broken[int(plan.chosen)] == broken.min()
    assert np.all(np.isfinite(plan.values))


def test_soft_becomes_hard_as_the_temperature_falls():
    line, hard = line_of(curved), plan_of(line_of(curved))
    far, near = (np.abs(plan_of(line, mode="soft", temperature=t).values - hard.values).max() for t in (1.0, 1e-3))
    assert near < 1e-4
    assert far > 1e-2
    through = plan_of(line, mode="straight_through", temperature=1.0)
    np.testing.assert_allclose(through.values, hard.values, rtol=1e-5, atol=1e-5)


def test_the_soft_plan_has_the_derivative_of_its_value(x64):
    line, begin = line_of(curved), state((10.23, 9.0, 0.4))  # no point on a row of the table, where it has a kink
    driving = driving_of(scene_params(), Relaxation(1.0, mode="soft"))
    mix = jnp.asarray(np.random.default_rng(0).normal(size=(6, 26)))

    @jax.jit
    def total(begin):
        found = choice.plan(line, begin, desired_speed=jnp.asarray(WISH), prediction=None, driving=driving)
        return jnp.sum(mix * found.values)

    slope = jax.jit(jax.grad(total))(begin)
    for name in ("station", "offset"):
        for i in range(3):
            step = jnp.zeros(3).at[i].set(1e-6)
            a, b = (total(begin.replace(**{name: getattr(begin, name) + sign * step})) for sign in (1, -1))
            np.testing.assert_allclose(getattr(slope, name)[i], (a - b) / 2e-6, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("at_once", [1, 2])
def test_many_scenarios_are_planned_like_each(at_once):
    lines = [line_of(curved), line_of(circular(0.0)), line_of(circular(0.01))]
    begins = [state(), state(offset=(1.0, 0.0, 0.0)), state((10.0, 7.0, 0.0))]
    stacked = [jax.tree.map(lambda *x: jnp.stack(x), *v) for v in (lines, begins)]
    wishes = jnp.array([WISH, 8.0, 12.0])
    program = jax.jit(choice.plans, static_argnames="at_once")
    driving = driving_of(scene_params(), Relaxation())
    many = program(*stacked, desired_speeds=wishes, predictions=None, driving=driving, at_once=at_once)
    for i in range(3):
        one = plan_of(lines[i], begins[i], wish=wishes[i])
        for found, wanted in zip(jax.tree.leaves(many), jax.tree.leaves(one), strict=True):
            np.testing.assert_allclose(found[i], wanted, rtol=1e-5, atol=1e-5)
