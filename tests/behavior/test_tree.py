"""The decision tree of Fig. 5: every outcome, in its order; soft against hard."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.behavior import tree
from urbanjax.behavior.tree import EGO, MICRO, ROUTE, Conditions, TSPSParams
from urbanjax.numerics.soft import Relaxation
from urbanjax.types import Decision
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.params import VehicleParams

FIELDS = (
    "route_feasible",
    "stuck",
    "micro_feasible",
    "turning_at_signal",
    "side_occupied",
    "return_occupied",
    "stoppable",
)


def conditions(**degrees: float) -> Conditions:
    defaults = dict.fromkeys(FIELDS, 0.0) | {"micro_feasible": 1.0, "stoppable": 1.0}
    return Conditions(**{k: jnp.asarray(v) for k, v in (defaults | degrees).items()})


def oracle(s: dict[str, bool], side_gates_stuck: bool, stuck_needs_micro: bool) -> tuple[int, Decision]:
    """Fig. 5 written as the nested ifs of the text."""
    if s["route_feasible"]:
        return ROUTE, Decision.ROUTE_FEASIBLE
    may_escape = s["stuck"] and (s["micro_feasible"] or not stuck_needs_micro)
    if may_escape and not (side_gates_stuck and s["side_occupied"]):
        return MICRO, Decision.STUCK_ESCAPE
    if not s["micro_feasible"]:
        if not s["stoppable"]:
            return EGO, Decision.EMERGENCY_STOP  # the safest, here
        return (EGO if s["return_occupied"] else ROUTE), Decision.MICRO_INFEASIBLE
    if s["turning_at_signal"]:
        return ROUTE, Decision.TURN_AT_SIGNAL
    if s["side_occupied"]:
        return EGO, Decision.SIDE_OCCUPIED
    return MICRO, Decision.OVERTAKE


@pytest.mark.parametrize("side_gates_stuck", [False, True])
@pytest.mark.parametrize("stuck_needs_micro", [False, True])
def test_equals_the_nested_ifs_on_every_input(side_gates_stuck, stuck_needs_micro):
    params = TSPSParams(side_gates_stuck=side_gates_stuck, stuck_needs_micro=stuck_needs_micro)
    cases = list(itertools.product([False, True], repeat=len(FIELDS)))
    columns = np.array(cases, float).T
    batch = Conditions(**{name: jnp.asarray(column) for name, column in zip(FIELDS, columns, strict=True)})
    safest = jnp.eye(3)[EGO]
    selection = jax.vmap(lambda s: tree.decide(s, params, safest=safest))(batch)
    seen = set()
    for i, case in enumerate(cases):
        path, decision = oracle(dict(zip(FIELDS, case, strict=True)), side_gates_stuck, stuck_needs_micro)
        seen.add(decision)
        assert np.array_equal(selection.path[i], np.eye(3)[path]), (case, decision)
        assert np.array_equal(selection.decision[i], np.eye(len(Decision))[decision]), (case, decision)
        assert float(selection.emergency[i]) == (decision == Decision.EMERGENCY_STOP)
    assert seen == set(Decision)


def test_weights_sum_to_one_for_any_degrees():
    degrees = np.random.default_rng(0).uniform(size=(len(FIELDS), 200))
    batch = Conditions(**{name: jnp.asarray(column) for name, column in zip(FIELDS, degrees, strict=True)})
    safest = jnp.asarray([0.2, 0.5, 0.3])
    selection = jax.vmap(lambda s: tree.decide(s, TSPSParams(), safest=safest))(batch)
    np.testing.assert_allclose(selection.path.sum(axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(selection.decision.sum(axis=1), 1, atol=1e-6)
    assert float(selection.path.min()) >= -1e-6


def remember(state, speed, held, route_free=0.0, micro=1.0, mode="hard", period=0.1, **params):
    driving = Driving(VehicleParams(), TSPSParams(**params), Relaxation(mode=mode, temperature=1e-3), period)
    given = {"speed": speed, "held": held, "route_free": route_free, "micro": micro}
    return tree.remember(state, driving, **{name: jnp.asarray(value) for name, value in given.items()})


@pytest.mark.parametrize("period", [0.1, 0.25])
@pytest.mark.parametrize("mode", ["hard", "soft"])
def test_time_stuck_rises_is_held_at_red_and_cleared_by_moving(mode, period):
    state = tree.init(jnp.zeros(()).dtype)
    for _ in range(4):
        state = remember(state, speed=0.0, held=0.0, mode=mode, period=period)
    assert float(state.stuck) == pytest.approx(4 * period)
    for _ in range(3):
        state = remember(state, speed=0.0, held=1.0, mode=mode, period=period)
    assert float(state.stuck) == pytest.approx(4 * period)
    state = remember(state, speed=5.0, held=0.0, mode=mode, period=period)
    assert float(state.stuck) == pytest.approx(0)


def test_a_blocked_route_counts_only_after_some_steps():
    state, blocked = tree.init(jnp.zeros(()).dtype), []
    for _ in range(6):
        state = remember(state, speed=5.0, held=0.0, route_free=0.0, patience=0.4)
        blocked.append(float(state.blocked))
    np.testing.assert_allclose(blocked, 1 - 0.75 ** np.arange(1, 7), rtol=1e-5)


def test_a_path_that_was_infeasible_is_doubted_for_a_while():
    state = remember(tree.init(jnp.dtype("float32")), speed=5.0, held=0.0, micro=0.0, confidence=0.5)
    doubts = []
    for _ in range(6):
        doubts.append(float(state.doubt))
        state = remember(state, speed=5.0, held=0.0, micro=1.0, confidence=0.5)
    np.testing.assert_allclose(doubts, [1.0, 0.8, 0.6, 0.4, 0.2, 0.0], atol=1e-6)
