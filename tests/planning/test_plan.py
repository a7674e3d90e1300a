import jax
import numpy as np
import pytest

from tests.planning.conftest import seen, small_params
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning import plan as plans
from urbanjax.planning.explain import explain
from urbanjax.planning.macro import MACRO_TERMS
from urbanjax.planning.micro import MICRO_TERMS, REASONS
from urbanjax.types import as_arrays
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.params import VehicleParams


@pytest.fixture(scope="module")
def made(scenes):
    window = scenes.road()
    params = small_params()
    memory = as_arrays(plans.nothing(params))
    step = jax.jit(lambda situation, driving, memory: plans.plan(situation, driving, memory=memory))
    progress, state = scenes.ego(window, offset=0.3)
    cars = scenes.traffic(window, [(45.0, 0.0, 0.0)])
    driving = as_arrays(Driving(VehicleParams(), params, Relaxation(), 0.1))
    first = step(seen(window, progress, state, cars), driving, memory)
    second = step(seen(window, progress, state, cars), driving, plans.remember(first))
    return first, second


def test_a_plan_that_is_remembered_has_no_transition_to_itself(made):
    first, second = made
    place = MICRO_TERMS.index("transition")
    assert float(first.micro.terms[:, place].max()) == 0
    assert float(second.micro.terms[:, place].max()) > 0
    np.testing.assert_allclose(second.micro.terms[int(first.micro.chosen), place], 0, atol=1e-3)


def test_an_explanation_holds_every_term_and_every_rejection(made):
    plan = made[0]
    table = explain(plan)
    rows = {name: i for i, name in enumerate(table["quantity"])}
    assert all(len(column) == len(rows) for column in table.values())
    assert set(MICRO_TERMS) | set(MACRO_TERMS) | {f"limit: {name}" for name in REASONS} <= rows.keys()
    terms = sum(table["chosen"][rows[name]] for name in MICRO_TERMS)
    assert table["chosen"][rows["cost"]] == pytest.approx(terms, rel=1e-4)
    assert table["chosen"][rows["cost"]] < table["runner-up"][rows["cost"]]
    assert table["chosen"][rows["all limits"]] == "kept"
    broken = np.asarray(plan.micro.reasons)
    assert table["candidates rejected"][rows["limit: collision"]] == broken[:, REASONS.index("collision")].sum() > 0
    assert table["candidates rejected"][rows["all limits"]] == broken.any(1).sum()
    macro = sum(table["macro plan"][rows[name]] for name in MACRO_TERMS)
    assert table["macro plan"][rows["cost"]] == pytest.approx(macro, rel=1e-4)
