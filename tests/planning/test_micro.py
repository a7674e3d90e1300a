import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.planning.conftest import small_params
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning import micro
from urbanjax.planning.micro import MICRO_TERMS, REASONS
from urbanjax.planning.previous import nothing, remember
from urbanjax.types import as_arrays
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.params import VehicleParams


def reason(plan, name):
    return np.asarray(plan.reasons)[:, REASONS.index(name)]


def test_the_chosen_candidate_is_the_cheapest_feasible_one(planner, scenes):
    window = scenes.road()
    _, fan, plan = planner(window, scenes.ego(window), scenes.traffic(window, [(44.0, 0.0, 3.0)]))
    feasible = ~np.asarray(plan.reasons).any(axis=1)
    total = np.where(feasible, np.asarray(plan.terms).sum(axis=1), np.inf)
    assert feasible.any()
    assert not feasible.all()
    assert plan.chosen == total.argmin()
    assert plan.feasible == 1
    others = np.where(np.arange(total.size) == total.argmin(), np.inf, np.asarray(plan.cost))
    assert plan.runner_up == others.argmin()
    for name in ("offset", "position", "heading", "curvature"):
        np.testing.assert_allclose(getattr(plan.path, name), getattr(fan, name)[plan.chosen], atol=1e-4)
    np.testing.assert_array_equal(plan.path.station, fan.station)
    assert plan.clearance == plan.margin[plan.chosen]


def test_a_blocked_road_leaves_nothing_feasible_but_an_answer(planner, scenes):
    window = scenes.road()
    wall = [(32.0, 0.0, 0.0), (32.0, 3.5, 0.0), (32.0, 1.75, 0.0)]
    _, _, plan = planner(window, scenes.ego(window), scenes.traffic(window, wall))
    assert np.all(reason(plan, "collision"))
    assert plan.feasible == 0
    assert np.all(np.isfinite(plan.cost))
    assert np.all(np.isfinite(plan.path.position))


def test_a_collision_beyond_the_horizon_is_not_one_yet(planner, scenes, params):
    window = scenes.road(lanes=(2,))
    ego, cars = scenes.ego(window), scenes.traffic(window, [(62.0, 0.0, 0.0)])
    short = params.replace(micro=params.micro.replace(collision_horizon=1.0))
    _, _, near = planner(window, ego, cars, short)
    _, _, far = planner(window, ego, cars)
    assert near.feasible == 1
    assert far.feasible == 0


def test_a_slow_candidate_follows_where_the_lane_cannot_be_left(planner, scenes):
    window = scenes.road(lanes=(2,))
    cars = scenes.traffic(window, [(45.0, 0.0, 7.0)])
    _, fan, plan = planner(window, scenes.ego(window), cars)
    assert plan.feasible == 1
    assert fan.end.speed[plan.chosen] < 8


def test_reasons_are_the_limits_that_are_broken(planner, scenes, params):
    window = scenes.road(lanes=(2,), width=3.0)
    ego = scenes.ego(window, speed=10.0)
    tight = params.micro.replace(max_lateral_acceleration=0.5)
    wide = params.primitives.replace(offsets=(-1.5, 0.0, 1.5))
    _, fan, plan = planner(window, ego, scenes.traffic(window, []), params.replace(micro=tight, primitives=wide))
    off_centre = np.abs(np.asarray(fan.end.beside)) > 1
    np.testing.assert_array_equal(reason(plan, "off_road"), off_centre)
    across = np.abs(np.asarray(fan.speed) ** 2 * np.asarray(fan.curvature)).max(axis=1)
    np.testing.assert_array_equal(reason(plan, "lateral_acceleration"), across > 0.5)
    assert reason(plan, "lateral_acceleration").any()
    assert not reason(plan, "curvature").any()


def test_curvature_beyond_the_steering_is_a_reason(planner, scenes, params):
    window = scenes.road()
    short = params.primitives.replace(offsets=(-1.5, 0.0, 1.5), durations=(0.5, 4.0), min_length=3.0)
    _, fan, plan = planner(
        window, scenes.ego(window, speed=1.0), scenes.traffic(window, []), params.replace(primitives=short)
    )
    sharp = np.abs(fan.curvature).max(axis=1) > 0.95 * np.tan(0.6) / 2.8
    assert sharp.any()
    assert not sharp.all()
    np.testing.assert_array_equal(reason(plan, "curvature"), sharp)


def test_what_the_vehicle_already_does_is_no_reason(planner, scenes):
    window = scenes.road()
    _, fan, plan = planner(window, scenes.ego(window, speed=10.0, steering=0.14), scenes.traffic(window, []))
    assert np.all(fan.speed[:, 0] ** 2 * fan.curvature[:, 0] > 4)
    assert plan.feasible == 1


def test_an_oncoming_lane_is_road_only_where_it_may_be_entered(planner, scenes):
    slow = [(50.0, 0.0, 3.0)]
    for barred, feasible in (((), 1), ((2,), 0)):
        window = scenes.road(oncoming=(3,), barred=barred)
        _, _, plan = planner(window, scenes.ego(window), scenes.traffic(window, slow))
        assert plan.feasible == feasible


def test_terms_name_what_they_cost(planner, scenes, params):
    window = scenes.road()
    ego, cars = scenes.ego(window), scenes.traffic(window, [(50.0, 0.0, 3.0)])
    _, _, base = planner(window, ego, cars)
    for i, name in enumerate(MICRO_TERMS):
        weight = getattr(params.micro.weights, name)
        doubled = params.micro.replace(weights=params.micro.weights.replace(**{name: 2 * weight}))
        _, _, plan = planner(window, ego, cars, params.replace(micro=doubled))
        np.testing.assert_allclose(plan.terms[:, i], 2 * base.terms[:, i], rtol=1e-4, atol=1e-5)
        rest = np.arange(len(MICRO_TERMS)) != i
        np.testing.assert_allclose(plan.terms[:, rest], base.terms[:, rest], rtol=1e-4, atol=1e-5)


def test_a_cost_of_accelerating_keeps_the_present_speed_and_is_nothing_by_default(planner, scenes, params):
    window = scenes.road()
    ego, nobody = scenes.ego(window, speed=7.0), scenes.traffic(window, [])
    keeping = params.replace(micro=params.micro.replace(weights=params.micro.weights.replace(acceleration=10.0)))
    change = []
    for which in (params, keeping):
        _, fan, plan = planner(window, ego, nobody, which)
        change.append(float(jnp.abs(fan.end.speed[plan.chosen] - 7.0)))
        paid = np.asarray(plan.terms)[:, MICRO_TERMS.index("acceleration")]
        assert paid.any() == (which is keeping)
    assert change[1] < change[0]


def test_the_previous_path_attracts(planner, scenes, params):
    window = scenes.road()
    strong = params.micro.weights.replace(transition=1.0)
    strong = params.replace(micro=params.micro.replace(weights=strong))
    station = jnp.linspace(20.0, 90.0, 25)
    past = remember(jnp.linspace(20.0, 90.0, 12), jnp.zeros(12))
    chosen = []
    for offset in (-0.6, 0.0, 0.6):
        previous = (past, remember(station, jnp.full_like(station, offset)))
        _, fan, plan = planner(window, scenes.ego(window), scenes.traffic(window, []), strong, previous=previous)
        chosen.append(float(fan.end.beside[plan.chosen]))
    np.testing.assert_allclose(chosen, [-0.6, 0.0, 0.6], atol=1e-6)


def test_a_first_step_pays_no_transition(planner, scenes):
    window = scenes.road()
    wide, _, near = planner(window, scenes.ego(window, offset=1.0), scenes.traffic(window, []))
    assert wide.terms[3] == 0
    np.testing.assert_array_equal(near.terms[:, MICRO_TERMS.index("transition")], 0)


def test_the_nearer_an_obstacle_the_dearer(planner, scenes, params):
    window = scenes.road(lanes=(1, 2, 3))
    _, fan, _ = planner(window, scenes.ego(window), scenes.traffic(window, []))
    driving = as_arrays(Driving(VehicleParams(), params.micro, Relaxation(), 0.1))
    room = jax.jit(lambda fan, cars: micro.clearance(fan, driving, prediction=cars))
    cost, clearance = [], []
    for offset in (-6.0, -2.6, -2.4, -2.2, -2.0, -1.0):
        cars = scenes.traffic(window, [(40.0, offset, 0.0)])
        near = room(fan, cars)
        terms = micro.weighted_terms(fan, params.micro, room=near, previous=nothing(25))
        cost.append(np.asarray(terms[:, MICRO_TERMS.index("obstacle")]))
        clearance.append(np.asarray(near.min(axis=1)))
    assert np.all(np.diff(clearance, axis=0) <= 0)
    assert np.all(np.diff(cost, axis=0) >= 0)
    assert np.all(cost[0] == 0)
    assert np.all(cost[-1] > 0)


def test_weights_are_one_hot_in_hard_and_spread_in_soft(planner, scenes):
    window = scenes.road()
    ego, cars = scenes.ego(window, offset=0.3), scenes.traffic(window, [])
    _, _, hard = planner(window, ego, cars)
    _, _, soft = planner(window, ego, cars, mode="soft", temperature=1.5)
    assert sorted(np.unique(hard.weights)) == [0, 1]
    assert soft.weights.sum() == pytest.approx(1, abs=1e-5)
    assert soft.weights.max() < 0.9


def test_the_wheels_turn_as_fast_as_the_curvature_asks(planner, scenes):
    window = scenes.road()
    fan = planner(window, scenes.ego(window), scenes.traffic(window, []))[1]
    step, speed, growth = 2.0, 8.0, 0.004
    along = jnp.broadcast_to(step * jnp.arange(fan.station.size), fan.time.shape)
    clothoid = fan.replace(curvature=growth * along, time=along / speed)
    vehicle = VehicleParams()
    middle = vehicle.wheelbase * growth * (along[0, :-1] + step / 2)
    expected = vehicle.wheelbase * growth * speed / (1 + middle**2)
    np.testing.assert_allclose(micro.steering_rate(clothoid, vehicle)[0], expected, rtol=1e-4)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("steering_rate", {"steering_rate_share": 0.05}),
        ("acceleration", {"max_acceleration": 0.01}),
        ("deceleration", {"max_deceleration": 0.01}),
    ],
)
def test_what_is_beyond_a_limit_is_rejected_for_it_alone(planner, scenes, name, change):
    window = scenes.road()
    ego, cars = scenes.ego(window, offset=0.4, speed=10.0), scenes.traffic(window, [])
    free = planner(window, ego, cars)[2]
    params = small_params()
    tight = planner(window, ego, cars, params=params.replace(micro=params.micro.replace(**change)))[2]
    assert not reason(free, name).any()
    assert reason(tight, name).any()
    for other in REASONS:
        if other != name:
            np.testing.assert_array_equal(reason(tight, other), reason(free, other))
