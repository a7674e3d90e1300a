"""Laws of planning over generated roads, vehicles and traffic: symmetry, monotony, padding, continuity."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from tests.planning.conftest import LANES, small_params
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning import costs
from urbanjax.planning.lattice.search import layered_search
from urbanjax.types import as_arrays

# Double precision comes by a fixture that is the same for all examples.
few, many = (
    settings(
        max_examples=n,
        deadline=None,
        derandomize=True,
        database=None,
        phases=[Phase.generate],  # planning is too slow for shrinking, and steps keep examples readable
        suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    )
    for n in (12, 60)
)


def steps(low, high, step):
    """Multiples of `step` from low to high: round numbers, of which none is nearly, but not quite, zero."""
    return st.integers(round(low / step), round(high / step)).map(lambda k: k * step)


roads = st.fixed_dictionaries(
    {
        "curvature": steps(-0.02, 0.02, 0.001),
        "lanes": st.sampled_from([(2,), (2, 3), (1, 2), (1, 2, 3), (0, 1, 2, 3, 4)]),
        "oncoming": st.sampled_from([(), (3,), (1,), (3, 4)]),
        "barred": st.sampled_from([(), (1,), (2,)]),
        "width": steps(2.8, 4.0, 0.1),
    }
)
states = st.fixed_dictionaries(
    {
        "offset": steps(-1.2, 1.2, 0.01),
        "turned": steps(-0.15, 0.15, 0.01),
        "speed": steps(0.0, 14.0, 0.1),
        "steering": steps(-0.1, 0.1, 0.01),
        "acceleration": steps(-2.0, 2.0, 0.1),
    }
)
traffic = st.lists(st.tuples(steps(0.0, 120.0, 0.5), steps(-8.0, 8.0, 0.1), steps(-12.0, 12.0, 0.5)), max_size=3)


def mirrored(road, state, cars):
    lanes = {
        "lanes": tuple(LANES - 1 - q for q in road["lanes"]),
        "oncoming": tuple(LANES - 1 - q for q in road["oncoming"]),
        "barred": tuple(LANES - 2 - q for q in road["barred"]),
    }
    turned = {k: -v if k in ("offset", "turned", "steering") else v for k, v in state.items()}
    return road | lanes | {"curvature": -road["curvature"]}, turned, [(s, -d, v) for s, d, v in cars]


def planned(planner, scenes, road, state, cars, mode="soft", **ego):
    window = scenes.road(**road)
    return planner(window, scenes.ego(window, **state, **ego), scenes.traffic(window, cars), mode=mode)


@few
@given(road=roads, state=states, cars=traffic)
def test_left_and_right_are_alike(planner, scenes, x64, road, state, cars):
    a = planned(planner, scenes, road, state, cars)
    b = planned(planner, scenes, *mirrored(road, state, cars))
    np.testing.assert_allclose(a[0].value, b[0].value, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(a[0].terms, b[0].terms, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(a[0].offset, -b[0].offset, atol=1e-6)
    flip = np.arange(12).reshape(4, 3)[:, ::-1].ravel()
    np.testing.assert_allclose(a[1].curvature, -b[1].curvature[flip], atol=1e-7)
    np.testing.assert_allclose(a[2].terms, b[2].terms[flip], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(a[2].cost, b[2].cost[flip], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(a[2].path.offset, -b[2].path.offset, atol=1e-6)


@few
@given(
    road=roads,
    state=states,
    cars=traffic,
    origin=st.tuples(steps(-5000.0, 5000.0, 0.5), steps(-5000.0, 5000.0, 0.5)),
    heading=steps(-6.0, 6.0, 0.1),
)
def test_every_cost_moves_with_the_map(planner, scenes, x64, road, state, cars, origin, heading):
    a = planned(planner, scenes, road, state, cars)
    b = planned(planner, scenes, road | {"origin": origin, "heading": heading}, state, cars)
    np.testing.assert_allclose(a[0].value, b[0].value, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(a[0].terms, b[0].terms, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(a[0].offset, b[0].offset, atol=1e-6)
    np.testing.assert_allclose(a[1].curvature, b[1].curvature, atol=1e-7)
    np.testing.assert_allclose(a[2].terms, b[2].terms, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(a[2].cost, b[2].cost, rtol=1e-5, atol=1e-5)
    cos, sin = np.cos(heading), np.sin(heading)
    moved = np.asarray(a[2].path.position) @ np.array([[cos, sin], [-sin, cos]]) + origin
    np.testing.assert_allclose(moved, b[2].path.position, atol=1e-5)


@few
@given(
    road=roads,
    state=states,
    cars=traffic.filter(lambda cars: len(cars) < 3),
    junk=st.tuples(steps(-50.0, 200.0, 1.0), steps(-20.0, 20.0, 1.0), steps(0.0, 30.0, 1.0), steps(0.0, 20.0, 0.5)),
    mode=st.sampled_from(["hard", "soft"]),
)
def test_what_padding_holds_changes_nothing(planner, scenes, road, state, cars, junk, mode):
    window = scenes.road(**road)
    ego, clean = scenes.ego(window, **state), scenes.traffic(window, cars)
    x, y, speed, size = junk
    dirty = clean.replace(
        position=clean.position.at[2].set(jnp.array([x, y])),
        speed=clean.speed.at[2].set(speed),
        length=clean.length.at[2].set(size),
    )
    a, b = planner(window, ego, clean, mode=mode), planner(window, ego, dirty, mode=mode)
    jax.tree.map(np.testing.assert_array_equal, a, b)


@few
@given(state=states, cars=traffic, road=roads, shift=st.sampled_from(["offset", "turned", "speed", "station"]))
def test_soft_value_is_continuous_in_the_start(planner, scenes, x64, road, state, cars, shift):
    step = 1e-8  # a jump stays, however small the shift; a slope of 1e5 would not show
    here = state | {"station": 20.0}
    values = [planned(planner, scenes, road, here | {shift: here[shift] + d}, cars)[0].value for d in (0, step, -step)]
    np.testing.assert_allclose(values[1:], values[0], atol=1e-3)


@few
@given(
    state=states,
    lanes=st.sampled_from([(2,), (2, 3), (1, 2, 3)]),
    station=steps(30.0, 100.0, 0.5),
    aside=steps(1.0, 4.0, 0.1),
    farther=steps(0.1, 3.0, 0.1),
    side=st.sampled_from([-1, 1]),
    mode=st.sampled_from(["hard", "soft"]),
)
def test_value_never_rises_as_an_obstacle_moves_off_the_road(
    planner, scenes, x64, state, lanes, station, aside, farther, side, mode
):
    edge = 3.5 * (max(lanes) - 2 if side > 0 else 2 - min(lanes)) + 1.75
    near, far = (
        planned(planner, scenes, {"lanes": lanes}, state, [(station, side * (edge + d), 0.0)], mode)[0]
        for d in (aside, aside + farther)
    )
    assert float(far.value) <= float(near.value) + 1e-9
    inside = side * near.node_offset < edge  # nodes of missing lanes lie beyond the obstacle, which nears them
    assert np.all(far.node_clearance[inside] >= near.node_clearance[inside] - 1e-9)


@many
@given(
    clearance=steps(-5.0, 5.0, 0.01),
    more=steps(0.0, 5.0, 0.01),
    threshold=steps(0.1, 3.0, 0.1),
    kind=st.sampled_from(costs.BARRIERS),
)
def test_barrier_never_rises_with_clearance(clearance, more, threshold, kind):
    near, far = costs.barrier(jnp.array([clearance, clearance + more]), threshold, kind=kind)
    assert 0 <= far <= near
    assert costs.barrier(jnp.array(0.0), threshold, kind=kind) > 0
    assert costs.barrier(jnp.array(5 * threshold), threshold, kind=kind) < 1e-5


@pytest.fixture(scope="module")
def path_costs():
    """Every cost of a path of 8 points, by name."""

    def all_of(position, kappa, offset, speed, time):
        step = costs.segments(position)
        parts = {
            "length": step,
            "curvature": costs.curvature(kappa, step),
            "curvature_rate": costs.curvature_rate(kappa, step),
            "deviation": costs.deviation(offset, 0.5 * offset[::-1], counts=jnp.ones_like(offset), step=step),
            "slowness": costs.slowness(speed, jnp.full_like(speed, 14.0), time=time),
            "lateral_acceleration": costs.lateral_acceleration(speed, kappa, time=time),
            "acceleration": costs.acceleration(speed, step, time=time),
        }
        return jax.tree.map(jnp.sum, parts)

    return jax.jit(all_of)


@many
@given(
    seed=st.integers(0, 2**16),
    at=st.tuples(steps(-5000, 5000, 1.0), steps(-5000, 5000, 1.0)),
    heading=steps(-6, 6, 0.1),
)
def test_costs_of_a_path_are_the_same_anywhere_and_in_a_mirror(path_costs, x64, seed, at, heading):
    rng = np.random.default_rng(seed)
    position, kappa, offset = rng.normal(size=(8, 2)), rng.normal(0, 0.1, 8), rng.normal(size=8)
    speed, time = rng.uniform(0, 14, 8), np.cumsum(rng.uniform(0.1, 1, 8))
    cos, sin = np.cos(heading), np.sin(heading)
    moved = position @ np.array([[cos, sin], [-sin, cos]]) + at
    here = path_costs(position, kappa, offset, speed, time)
    for other in ((moved, kappa, offset), (position * [1, -1], -kappa, -offset)):
        there = path_costs(*other, speed, time)
        for name, value in here.items():
            np.testing.assert_allclose(there[name], value, rtol=1e-6, err_msg=name)


@pytest.fixture(scope="module")
def search():
    return jax.jit(layered_search)


@many
@given(
    seed=st.integers(0, 2**16),
    mode=st.sampled_from(["hard", "soft"]),
    temperature=st.sampled_from([0.01, 0.3, 3.0]),
)
def test_search_follows_its_costs(search, x64, seed, mode, temperature):
    rng, relaxation = np.random.default_rng(seed), as_arrays(Relaxation(temperature, mode=mode))
    start, edges = rng.uniform(0, 2, 4), rng.uniform(0, 2, (3, 4, 4))
    value, nodes, _ = search(start, edges, relaxation=relaxation)
    # Dearer edges never make a plan cheaper; what all edges of a layer cost more, the plan costs more.
    assert search(start, edges + rng.uniform(0, 1, edges.shape), relaxation=relaxation)[0] >= value - 1e-12
    tolls = rng.uniform(0, 5, 3)
    np.testing.assert_allclose(
        search(start, edges + tolls[:, None, None], relaxation=relaxation)[0], value + tolls.sum()
    )
    # Nodes have no order, and a node that is barred is as good as none.
    order = rng.permutation(4)
    shuffled = search(start[order], edges[:, order][:, :, order], relaxation=relaxation)
    np.testing.assert_allclose(shuffled[0], value, rtol=1e-12)
    np.testing.assert_allclose(shuffled[1], nodes[:, order], atol=1e-9)
    barred = np.pad(edges, ((0, 0), (0, 1), (0, 1)), constant_values=1e6)
    padded = search(np.pad(start, (0, 1), constant_values=1e6), barred, relaxation=relaxation)
    np.testing.assert_allclose(padded[0], value, rtol=1e-12)
    np.testing.assert_allclose(padded[1][:, :4], nodes, atol=1e-12)
    assert np.all(padded[1][:, 4] == 0)


def test_generated_scenes_reach_what_costs_tell(planner, scenes):
    """The properties above are empty where no term ever counts: one scene in which most do."""
    plan = planned(planner, scenes, {"oncoming": (3,)}, {"speed": 9.0, "offset": 0.4}, [(45.0, 0.3, 2.0)])
    assert np.sum(np.asarray(plan[0].terms) > 1e-6) >= 5
    assert np.sum(np.asarray(plan[2].terms).max(0) > 1e-6) >= 7
    assert small_params().macro.n_layers == plan[0].offset.size
