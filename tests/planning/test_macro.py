from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.planning.conftest import seen
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning import macro
from urbanjax.planning.cross_section import cross_sections
from urbanjax.planning.lattice import layers as lattice
from urbanjax.planning.lattice.edges import CORNER, fine_stations
from urbanjax.planning.macro import MACRO_TERMS, offset_at, profile_at
from urbanjax.planning.previous import nothing, remember
from urbanjax.types import as_arrays
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.params import VehicleParams


def test_a_free_road_is_followed_in_its_lane(planner, scenes):
    window = scenes.road()
    plan, _, _ = planner(window, scenes.ego(window), scenes.traffic(window, []))
    np.testing.assert_allclose(plan.offset, 0, atol=1e-6)
    assert plan.feasible == 1
    assert plan.value == pytest.approx(0, abs=1e-3)
    assert np.all(np.diff(plan.time) > 0)
    assert np.all(plan.speed <= 14.1)


def test_a_slow_leader_is_passed_in_the_next_lane(planner, scenes):
    window = scenes.road()
    plan, _, _ = planner(window, scenes.ego(window), scenes.traffic(window, [(50.0, 0.0, 3.0)]))
    assert plan.offset.max() > 2.0
    assert plan.feasible == 1
    assert plan.clearance > 0
    np.testing.assert_allclose(plan.terms.sum(), plan.value, rtol=1e-4)
    assert plan.terms[MACRO_TERMS.index("forbidden")] == 0


@pytest.mark.parametrize("blocked", [{"lanes": (2,)}, {"barred": (2,)}])
def test_no_lane_is_left_where_that_is_barred(planner, scenes, blocked):
    window = scenes.road(**blocked)
    plan, _, _ = planner(window, scenes.ego(window), scenes.traffic(window, [(50.0, 0.0, 3.0)]))
    assert np.abs(plan.offset).max() < 1.75
    assert plan.feasible == 0
    assert plan.terms[MACRO_TERMS.index("forbidden")] == 0


def test_the_way_back_over_a_solid_line_is_free(planner, scenes):
    window = scenes.road(oncoming=(3,), barred=(2,))
    plan, _, near = planner(window, scenes.ego(window, offset=3.5), scenes.traffic(window, []))
    np.testing.assert_allclose(plan.offset[-6:], 0, atol=1e-6)
    assert plan.feasible == 1
    assert near.feasible == 1


def test_the_road_ends_at_its_borders(planner, scenes):
    window = scenes.road(lanes=(2,), width=4.5)
    parked = scenes.traffic(window, [(55.0, -1.5, 0.0)])
    plan, _, _ = planner(window, scenes.ego(window), parked)
    assert 0 <= plan.offset.max() <= 4.5 / 2 - VehicleParams().width / 2 + 1e-4  # the node beyond would overhang it


@pytest.mark.parametrize("middle", [1.5, 1.75, 1.95])
def test_a_gap_between_two_nodes_is_met_in_its_middle(planner, scenes, middle):
    """Vehicles stand on both sides and leave the ego's width and 0.8 m, on a lattice of 0.7 m."""
    window, away = scenes.road(), (VehicleParams().width + 0.8 + 1.9) / 2
    beside = [(55.0, middle - away, 0.0), (55.0, middle + away, 0.0)]
    plan, _, _ = planner(window, scenes.ego(window, offset=1.0, speed=6.0), scenes.traffic(window, beside))
    there = np.argmin(np.abs(plan.station - 55.0))
    nearest = np.argmin(np.abs(plan.node_offset[there] - middle))
    assert plan.node_offset[there, nearest] == pytest.approx(middle, abs=0.01)
    assert plan.node_clearance[there, nearest] == pytest.approx(0.4, abs=0.01)
    assert plan.offset[there] == pytest.approx(middle, abs=0.25)
    assert plan.feasible == 1


def test_a_follower_does_not_drive_us_out_of_our_lane(planner, scenes):
    window = scenes.road()
    plan, _, near = planner(window, scenes.ego(window, speed=1.0), scenes.traffic(window, [(8.0, 0.0, 13.0)]))
    assert plan.feasible == 1
    assert near.feasible == 1
    np.testing.assert_allclose(plan.offset, 0, atol=1e-6)


def test_oncoming_traffic_keeps_us_out_of_its_lane(planner, scenes):
    window = scenes.road(oncoming=(3,))
    slow = (50.0, 0.0, 3.0)
    free, _, _ = planner(window, scenes.ego(window), scenes.traffic(window, [slow]))
    meets, _, _ = planner(window, scenes.ego(window), scenes.traffic(window, [slow, (95.0, 3.5, -10.0)]))
    assert free.feasible == 1
    assert free.terms[MACRO_TERMS.index("oncoming")] > 0
    assert meets.feasible == 0


def test_the_previous_plan_attracts(planner, scenes, params):
    window = scenes.road(lanes=(1, 2, 3))
    ego, cars = scenes.ego(window), scenes.traffic(window, [(50.0, 0.0, 3.0)])
    strong = params.replace(macro=params.macro.replace(weights=params.macro.weights.replace(transition=0.2)))
    station = jnp.linspace(20.0, 120.0, params.macro.n_layers)
    for side in (-1, 1):
        past = remember(station, jnp.full_like(station, 3.5 * side))
        past = (past, remember(jnp.linspace(20.0, 120.0, 25), jnp.full(25, 3.5 * side)))
        plan, _, _ = planner(window, ego, cars, strong, previous=past)
        assert side * plan.offset[np.abs(plan.offset).argmax()] > 2


def test_times_are_finite_and_smooth_at_standstill(planner, scenes):
    window = scenes.road(curvature=0.02)
    plan, fan, near = planner(window, scenes.ego(window, speed=0.0), scenes.traffic(window, []))
    assert 0.5 < plan.time[0] < 5
    assert np.all(np.diff(plan.time) > 0)
    assert np.all(np.isfinite(fan.time))
    assert near.feasible == 1


def test_curves_are_taken_slowly(planner, scenes):
    window = scenes.road(curvature=0.04)
    plan, _, _ = planner(window, scenes.ego(window, speed=5.0), scenes.traffic(window, []))
    np.testing.assert_allclose(plan.speed.max(), np.sqrt(2.5 / 0.04), rtol=0.02)


def test_the_plan_is_read_off_smoothly(planner, scenes):
    window = scenes.road()
    plan, _, _ = planner(window, scenes.ego(window, offset=0.4), scenes.traffic(window, [(50.0, 0.0, 3.0)]))
    station = jnp.linspace(20.0, 200.0, 400)
    offset, slope, _ = offset_at(plan, station)
    assert offset[0] == pytest.approx(0.4, abs=1e-5)
    assert offset[-1] == pytest.approx(float(plan.offset[-1]), abs=1e-5)
    np.testing.assert_allclose(np.gradient(offset, station)[1:-1], slope[1:-1], atol=0.02)
    time, speed = profile_at(plan, jnp.concatenate([plan.station, plan.station[-1:] + 14.0]))
    np.testing.assert_allclose(time[:-1], plan.time, rtol=1e-4)
    np.testing.assert_allclose(speed[:-1], plan.speed, rtol=1e-4)
    np.testing.assert_allclose(time[-1], plan.time[-1] + 14 / plan.speed[-1], rtol=1e-4)


def test_the_inside_of_a_bend_is_shorter_by_its_angle_times_the_offset(planner, scenes, params):
    window = scenes.road(curvature=0.02, lanes=(2, 3))
    weights = params.macro.weights
    free = weights.replace(**dict.fromkeys(("curvature", "route", "centre", "lane_change"), 0.0))
    plan, _, _ = planner(
        window,
        scenes.ego(window, offset=3.5),
        scenes.traffic(window, []),
        params.replace(macro=params.macro.replace(weights=free)),
    )
    assert plan.feasible == 1
    np.testing.assert_allclose(plan.offset[2:], 3.5 + 3.5 / 3 * (plan.offset[-1] > 4), atol=1e-4)
    way = float(plan.station[-1] - plan.start_station)
    expected = -0.02 * np.sum(
        np.diff(plan.station, prepend=20.0) * np.convolve([3.5, *plan.offset], [0.5, 0.5], "valid")
    )
    length = float(plan.terms[MACRO_TERMS.index("length")])
    assert length == pytest.approx(expected, abs=0.15)  # the steps sideways add some
    assert length < -0.02 * 3.4 * way


def test_steps_beyond_the_curvature_limit_are_forbidden(planner, scenes, params):
    window = scenes.road()
    ego, cars = scenes.ego(window), scenes.traffic(window, [(50.0, 0.0, 3.0)])
    edges = params.macro.weights.edges.replace(max_curvature=1e-3)
    tight = params.replace(macro=params.macro.replace(weights=params.macro.weights.replace(edges=edges)))
    free, held = planner(window, ego, cars)[0], planner(window, ego, cars, tight)[0]
    assert np.ptp(free.offset) > 3
    assert np.ptp(held.offset) == pytest.approx(0, abs=1e-5)
    assert held.terms[MACRO_TERMS.index("forbidden")] == 0


def test_a_bend_sharper_than_the_steering_is_followed_along_the_reference(planner, scenes):
    window = scenes.road(curvature=0.3, lanes=(2,))
    plan, _, _ = planner(window, scenes.ego(window, speed=1.0), scenes.traffic(window, []))
    assert plan.feasible == 1
    assert plan.terms[MACRO_TERMS.index("forbidden")] == 0


def costs(situation, driving):
    """What the plan of a small lattice adds up: cost of its starts [M] and of its edges [S - 1, M, M]."""
    params, offset = driving.params, situation.progress.offset
    weighing, previous = driving.of(params.weights), nothing(params.n_layers)
    spacing = macro.layer_spacing(situation, params)
    station = situation.progress.station + spacing * jnp.arange(params.n_layers + 1).astype(spacing.dtype)
    road = cross_sections(situation.window, fine_stations(station, CORNER))
    found = macro.plan(situation, driving, previous=previous)
    speed = jnp.concatenate([found.start_speed[None], found.speed])
    time = jnp.concatenate([0 * found.time[:1], found.time])
    layers = lattice.build(road, speed, time=time, nodes_per_lane=params.nodes_per_lane)
    layers = layers.replace(offset=found.node_offset)  # where they were moved to
    nodes, _ = lattice.node_terms(layers, weighing, room=found.node_clearance, previous=previous)
    ways = lattice.ways(layers, offset, vehicle=driving.vehicle)
    start, _ = lattice.start_terms(layers, weighing, ways=ways, offset=offset)
    edges, _ = lattice.edge_terms(layers, weighing, ways=ways)
    node = sum(nodes.values())
    return found, sum(start.values()) + node[0], sum(edges.values()) + node[1:, None, :]


def test_the_plan_is_the_best_of_all_paths(scenes, x64):
    window = scenes.road(curvature=0.01, lanes=(1, 2, 3), barred=(1,))
    progress, state = scenes.ego(window, offset=0.4, speed=9.0)
    cars = scenes.traffic(window, [(45.0, 0.2, 2.0), (70.0, 3.3, 6.0)])
    params = as_arrays(macro.MacroParams(n_layers=4, nodes_per_lane=2, min_spacing=10.0))
    driving = as_arrays(Driving(VehicleParams(), params, Relaxation(), 0.1))
    plan, start, edges = jax.jit(costs)(seen(window, progress, state, cars), driving)
    paths = np.array(list(product(range(10), repeat=4)))
    total = np.asarray(start)[paths[:, 0]] + sum(np.asarray(edges)[i, paths[:, i], paths[:, i + 1]] for i in range(3))
    best = paths[total.argmin()]
    assert float(plan.value) == pytest.approx(total.min(), abs=1e-9)
    np.testing.assert_array_equal(np.asarray(plan.marginal).argmax(1), best)
    np.testing.assert_allclose(plan.offset, np.asarray(plan.node_offset)[np.arange(4), best])
    assert np.ptp(plan.offset) > 1
