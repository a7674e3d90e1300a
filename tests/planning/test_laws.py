"""Limits and gradients of the planning pipeline as a whole; its symmetries are in `test_properties.py`."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.planning.conftest import run, small_params
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning.previous import nothing
from urbanjax.types import as_arrays
from urbanjax.vehicle.params import VehicleParams

CARS = [(50.0, 0.3, 3.0), (110.0, 3.2, -6.0), (5.0, 0.0, 12.0)]
STATE = {"offset": 0.3, "turned": 0.04, "speed": 9.0, "steering": 0.03, "acceleration": 0.5}


def test_kilometres_from_the_origin_single_precision_is_enough(planner, scenes):
    plans = []
    for origin in ((0.0, 0.0), (6000.0, -4000.0)):
        window = scenes.road(curvature=0.01, origin=origin)
        plans.append(planner(window, scenes.ego(window, **STATE), scenes.traffic(window, CARS)))
    (a, _, near_a), (b, _, near_b) = plans
    np.testing.assert_allclose(a.offset, b.offset, atol=0.01)
    np.testing.assert_allclose(near_a.path.offset, near_b.path.offset, atol=0.01)
    np.testing.assert_allclose(near_a.margin, near_b.margin, atol=0.01)


def test_objects_in_any_order(planner, scenes):
    window = scenes.road()
    ego = scenes.ego(window, **STATE)
    a = planner(window, ego, scenes.traffic(window, CARS))
    b = planner(window, ego, scenes.traffic(window, CARS[::-1]))
    np.testing.assert_array_equal(a[2].cost, b[2].cost)
    np.testing.assert_array_equal(a[0].offset, b[0].offset)


@pytest.mark.parametrize("cars", [[], CARS[:1], CARS])
def test_temperature_to_zero_is_the_hard_plan(planner, scenes, cars, x64):
    window = scenes.road()
    ego, cars = scenes.ego(window, **STATE), scenes.traffic(window, cars)
    hard, cold = planner(window, ego, cars), planner(window, ego, cars, mode="soft", temperature=1e-4)
    np.testing.assert_allclose(hard[0].offset, cold[0].offset, atol=1e-3)
    np.testing.assert_allclose(hard[0].value, cold[0].value, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(hard[2].weights, cold[2].weights, atol=1e-6)
    for name in ("position", "heading", "curvature"):
        np.testing.assert_allclose(getattr(hard[2].path, name), getattr(cold[2].path, name), atol=1e-3)
    np.testing.assert_allclose(hard[2].feasible, cold[2].feasible, atol=1e-6)
    np.testing.assert_allclose(hard[2].clearance, cold[2].clearance, atol=1e-3)


def test_straight_through_has_the_value_of_hard(planner, scenes):
    window = scenes.road()
    ego, cars = scenes.ego(window, **STATE), scenes.traffic(window, CARS)
    hard, through = planner(window, ego, cars), planner(window, ego, cars, mode="straight_through")
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-4), hard, through)


def outcome(params, state, prediction, window, progress):
    """A smooth scalar that depends on every stage: where the path leads, how soon, and at what cost and clearance."""
    wide, _, near = run(
        window,
        progress,
        state,
        prediction,
        nothing(12),
        nothing(25),
        as_arrays(VehicleParams()),
        params,
        as_arrays(Relaxation(0.3, mode="soft")),
    )
    scalar = near.path.offset[-8] + near.time[-1] + jnp.sum(near.weights * near.cost) / 50 + wide.offset[6]
    return scalar + near.clearance + near.feasible + wide.feasible + wide.value / 50


@pytest.fixture(scope="module")
def gradient():
    """Value and gradient by all parameters, the ego's state and the prediction."""
    return jax.jit(jax.value_and_grad(outcome, argnums=(0, 1, 2), allow_int=True))


def finite(tree):
    floats = [x for x in jax.tree.leaves(tree) if x.dtype != jax.dtypes.float0]
    return all(np.all(np.isfinite(x)) for x in floats)


@pytest.mark.slow  # grads/test_closed_loop.py looks along random directions by default
def test_gradients_match_central_differences(gradient, scenes, x64):
    window = scenes.road(curvature=0.004)
    progress, state = scenes.ego(window, **STATE)
    cars, params = scenes.traffic(window, CARS), small_params()
    _, (by_params, by_state, _) = gradient(params, state, cars, window, progress)
    leaves, tree = jax.tree.flatten(params)
    slopes = jax.tree.leaves(by_params)
    names = [jax.tree_util.keystr(path) for path, _ in jax.tree.flatten_with_path(params)[0]]
    moved = 0
    for i, (leaf, slope, name) in enumerate(zip(leaves, slopes, names, strict=True)):
        h = 1e-6 * max(1.0, abs(float(leaf)))
        if "prediction" in name:
            continue
        values = []
        for sign in (1, -1):
            changed = jax.tree.unflatten(tree, [*leaves[:i], leaf + sign * h, *leaves[i + 1 :]])
            values.append(float(gradient(changed, state, cars, window, progress)[0]))
        difference = (values[0] - values[1]) / (2 * h)
        assert float(slope) == pytest.approx(difference, rel=2e-3, abs=1e-6), name
        moved += abs(difference) > 1e-6
    assert moved > 25
    h = 1e-6
    values = [float(gradient(params, state.replace(speed=state.speed + s), cars, window, progress)[0]) for s in (h, -h)]
    assert float(by_state.speed) == pytest.approx((values[0] - values[1]) / (2 * h), rel=2e-3)


SCENES = {
    "standstill": ({"speed": 0.0}, {}, CARS),
    "straight_and_free": ({"speed": 10.0}, {}, []),
    "curve": ({"speed": 5.0, "steering": 0.1}, {"curvature": 0.05}, CARS[:1]),
    "inside_another_car": ({"speed": 4.0}, {}, [(21.4, 0.0, 0.0)]),
    "all_at_one_place": ({"speed": 0.0}, {}, [(21.4, 0.0, 0.0)] * 3),
    "off_the_road": ({"speed": 3.0, "offset": -8.0, "turned": 1.2}, {}, CARS),
    "across_the_road": ({"speed": 1.0, "turned": 2.5, "steering": 0.6, "acceleration": -6.0}, {}, CARS),
    "one_lane_blocked": ({"speed": 6.0}, {"lanes": (2,)}, [(30.0, 0.0, 0.0)]),
}


@pytest.mark.parametrize("name", SCENES)
def test_value_and_gradient_are_finite(gradient, scenes, name, x64):
    state, road, cars = SCENES[name]
    window = scenes.road(**road)
    progress, ego = scenes.ego(window, **state)
    value, slopes = gradient(small_params(), ego, scenes.traffic(window, cars), window, progress)
    assert np.isfinite(value)
    assert finite(slopes)
