"""The nearest box of each point: its value is the softmin of all gaps, and its derivative that of the softmin."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.trees import float_leaves
from urbanjax.numerics import soft
from urbanjax.numerics.soft import MODES, Relaxation
from urbanjax.planning import clearance, nearest
from urbanjax.planning.clearance import ClearanceParams, Passage
from urbanjax.types import Prediction, as_arrays
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.params import VehicleParams

N, TIMES = 23, 5


def meeting(count, mode, *, spread=12.0, swept=True, seed=0):
    """The ego among boxes all over the place; the first of them does not count in part, the last one not at all."""
    rng = np.random.default_rng(seed)
    prediction = Prediction(
        position=rng.normal(size=(count, TIMES, 2)) * spread,
        heading=rng.uniform(-3, 3, (count, 1)) + rng.normal(size=(count, TIMES)) * 0.1,
        speed=rng.uniform(0, 15, count),
        length=rng.uniform(3, 9, count),
        width=rng.uniform(1, 2.5, count),
        time=np.linspace(0, 8, TIMES),
        valid=np.arange(count) < max(count - 1, 1),
    )
    step = {"step": rng.uniform(0.5, 3, N), "step_time": rng.uniform(0.1, 0.4, N)} if swept else {}
    passage = Passage(rng.normal(size=(N, 2)) * spread, rng.uniform(-3, 3, N), rng.uniform(0, 11, N), **step)
    driving = Driving(VehicleParams(), ClearanceParams(far=25.0), Relaxation(temperature=0.2, mode=mode), 0.1)
    ignored = np.where(np.arange(count) == 0, 0.3, 0.0)
    return as_arrays(nearest.Meeting(passage, driving, jax.tree.map(jnp.asarray, prediction), jnp.asarray(ignored)))


def plain(met):
    """The softmin over all gaps, which differentiates itself."""
    room = clearance.gaps(met.passage, met.driving, prediction=met.prediction, ignored=met.ignored)
    return soft.minimum(room, met.driving.relaxation, scale=met.driving.params.gap_scale)


def ours(met):
    return nearest.nearest(met.passage, met.driving, prediction=met.prediction, ignored=met.ignored)


def gradients(function, met, weights):
    values, filled = float_leaves(met)
    return jax.jit(jax.grad(lambda v: jnp.sum(weights * function(filled(v)))))(values)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("swept", [False, True])
def test_of_few_boxes_value_and_derivative_are_those_of_the_softmin(mode, swept, x64):
    met = meeting(nearest.GRADED, mode, swept=swept)
    weights = jnp.asarray(np.random.default_rng(1).normal(size=N))
    np.testing.assert_allclose(ours(met), plain(met), rtol=1e-12, atol=1e-12)
    for found, expected in zip(gradients(ours, met, weights), gradients(plain, met, weights), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def test_of_many_boxes_what_is_left_out_has_next_to_no_weight(x64):
    met = meeting(40, "soft")
    room = clearance.gaps(met.passage, met.driving, prediction=met.prediction, ignored=met.ignored)
    near = np.sort(np.asarray(room), axis=1)
    temperature = met.driving.relaxation.temperature * met.driving.params.gap_scale
    left_out = np.exp((near[:, 0] - near[:, nearest.GRADED]) / temperature)
    weights = jnp.asarray(left_out < 1e-8, room.dtype)
    assert 0.5 * N < jnp.sum(weights) < N  # of the others there is nothing to be said
    for found, expected in zip(gradients(ours, met, weights), gradients(plain, met, weights), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)


def test_where_nobody_is_near_the_derivative_is_that_of_what_counts_as_far(x64):
    met = meeting(40, "soft")
    away = met.prediction.replace(position=met.prediction.position + 1e4)
    met = met.replace(prediction=away)
    slope = jax.jit(jax.grad(lambda far: jnp.sum(ours(_with_far(met, far)))))(met.driving.params.far)
    assert slope == pytest.approx(N)
    for found, expected in zip(gradients(ours, met, jnp.ones(N)), gradients(plain, met, jnp.ones(N)), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def _with_far(met, far):
    return met.replace(driving=met.driving.of(met.driving.params.replace(far=far)))


def test_both_modes_of_differentiation_agree(x64):
    met = meeting(12, "straight_through")
    values, filled = float_leaves(met)
    rng = np.random.default_rng(3)
    along = [jnp.asarray(rng.normal(size=value.shape)) for value in values]
    weights = jnp.asarray(rng.normal(size=N))
    value, change = jax.jit(lambda v, d: jax.jvp(lambda v: jnp.sum(weights * ours(filled(v))), (v,), (d,)))(
        values, along
    )
    backwards = sum(jnp.sum(g * d) for g, d in zip(gradients(ours, met, weights), along, strict=True))
    assert value == pytest.approx(float(jnp.sum(weights * plain(met))))
    assert change == pytest.approx(float(backwards))


def test_tiles_change_nothing(monkeypatch, x64):
    met = meeting(9, "soft")
    weights = jnp.arange(float(N))
    whole = gradients(ours, met, weights)
    monkeypatch.setattr(nearest, "TILE", 5)
    for found, expected in zip(gradients(ours, met, weights), whole, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def test_the_smallest_are_found_in_order_also_far_below_zero():
    gap = np.random.default_rng(0).normal(size=(50, 33)).astype(np.float32) * 40
    gap[0] = -1e5
    found = np.asarray(nearest.smallest(jnp.asarray(gap), 4))
    np.testing.assert_allclose(np.take_along_axis(gap, found, axis=1)[1:], np.sort(gap, axis=1)[1:, :4], atol=2e-3)
    assert all(len(set(row)) == 4 for row in found.tolist())
