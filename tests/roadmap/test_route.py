"""Eq. 12: routes equal scipy's Dijkstra; lane changes, via-points, laps and failures."""

import jax
import numpy as np
import pytest

from tests.roadmap.oracle import oracle, walked_cost
from urbanjax.roadmap.route import RouteParams, Trip, cost_to_go, plan_route, route_between
from urbanjax.types import RouteError, Status

L = 24
cost_to_go_jit = jax.jit(cost_to_go, static_argnames="changes")
plan_route_jit = jax.jit(plan_route)


def test_route_walks_its_least_cost_on_random_graphs(random_graph):
    params = RouteParams(n_links=L)
    found = 0
    for seed in range(40):
        graph = random_graph(100 + seed)
        rng = np.random.default_rng(seed)
        start, goal = (int(k) for k in rng.integers(0, L - 2, 2))
        route = plan_route_jit(graph, start, trip=Trip(goal), params=params)
        best = oracle(graph, goal, params)[start]
        if np.isinf(best):
            assert int(route.status) == Status.UNREACHABLE
            continue
        found += 1
        assert int(route.status) == Status.OK
        assert walked_cost(graph, route, params) == pytest.approx(best, rel=1e-5)
        assert float(route.cost) == pytest.approx(best, rel=1e-5)
    assert found > 15


def test_lexicographic_search_minimises_changes_first(random_graph):
    params, pair = RouteParams(search="lexicographic", n_links=L), RouteParams(change_length=1e5, n_links=L)
    for seed in range(20):
        graph = random_graph(200 + seed)
        rng = np.random.default_rng(seed)
        start, goal = (int(k) for k in rng.integers(0, L - 2, 2))
        route = plan_route_jit(graph, start, trip=Trip(goal), params=params)
        best = oracle(graph, goal, pair)[start]
        if np.isfinite(best):
            changes = int(np.sum(route.change))
            assert changes == int(best // 1e5)
            assert float(route.cost) == pytest.approx(best - 1e5 * changes, rel=1e-5)


def test_two_stage_takes_the_route_without_changes_if_there_is_one(random_graph):
    params = RouteParams(search="two_stage", change_length=0.0, n_links=L)
    kinds = set()
    for seed in range(20):
        graph = random_graph(300 + seed)
        rng = np.random.default_rng(seed)
        start, goal = (int(k) for k in rng.integers(0, L - 2, 2))
        route = plan_route_jit(graph, start, trip=Trip(goal), params=params)
        plain, free = (oracle(graph, goal, params, changes)[start] for changes in (False, True))
        best = plain if np.isfinite(plain) else free
        if np.isfinite(best):
            assert float(route.cost) == pytest.approx(best, rel=1e-5)
            assert not np.isfinite(plain) or not np.any(route.change)
            kinds.add(bool(np.isfinite(plain)))
    assert kinds == {True, False}


def test_free_lane_changes_do_not_trap_the_trace_back(road):
    route = plan_route(road, 2, trip=Trip(5), params=RouteParams(change_length=0.0, n_links=8))
    assert int(route.status) == Status.OK
    assert float(route.cost) == pytest.approx(200.0)


def test_lane_change_is_planned_where_the_goal_is_on_another_lane(road):
    route = route_between(road, 0, goal=5, params=RouteParams(n_links=8))
    links = np.asarray(route.link)[np.asarray(route.valid)]
    assert links[0] == 0
    assert links[-1] == 5
    assert int(np.sum(route.change)) == 2
    assert float(route.cost) == pytest.approx(200.0 + 2 * 50.0)


def test_district_lap_is_the_whole_course(district, course_links):
    route = route_between(district, 0, goal=course_links[-1])
    assert np.asarray(route.link)[np.asarray(route.valid)].tolist() == course_links
    assert float(route.cost) == pytest.approx(float(np.sum(np.asarray(district.length)[course_links])), rel=1e-5)


def test_laps_repeat_the_course(district, course_links):
    route = route_between(district, 0, goal=course_links[-1], laps=3)
    assert np.asarray(route.link)[np.asarray(route.valid)].tolist() == 3 * course_links
    back = route_between(district, 0, goal=0, laps=2)
    assert np.asarray(back.link)[np.asarray(back.valid)].tolist() == [*course_links, *course_links, 0]


def test_via_links_are_visited_in_order(district, course_links):
    other = int(district.right_link[course_links[20]])
    route = route_between(district, 0, goal=course_links[40], via=(other,))
    links = np.asarray(route.link)[np.asarray(route.valid)].tolist()
    assert other in links
    assert links[-1] == course_links[40]
    assert int(np.sum(route.change)) == 2


def test_start_that_is_the_goal_is_a_route_of_one_link(road):
    route = route_between(road, 3, goal=3, params=RouteParams(n_links=8))
    assert int(np.sum(route.valid)) == 1
    assert float(route.cost) == pytest.approx(100.0)


@pytest.mark.parametrize(
    ("start_and_way", "message"),
    [
        ((3, {"goal": 0}), "link 0 cannot be reached from link 3"),
        ((0, {"goal": 99}), "goal link 99 is not in the road graph"),
        ((-1, {"goal": 0}), "start link -1 is not in the road graph"),
        ((0, {"goal": 3, "via": (77,)}), "via link 77 is not in the road graph"),
        ((0, {"goal": 3, "laps": 0}), "laps is 0"),
    ],
)
def test_impossible_routes_name_their_links(road, start_and_way, message):
    start, way = start_and_way
    with pytest.raises(RouteError, match=message):
        route_between(road, start, **way, params=RouteParams(n_links=8))


def test_negative_penalty_is_refused_and_harmless_inside_jit(road):
    with pytest.raises(RouteError, match="penalties are"):
        route_between(road, 0, goal=5, params=RouteParams(change_length=-1.0, n_links=8))
    assert np.all(np.isfinite(cost_to_go_jit(road, 5, params=RouteParams(change_length=-1.0))))


def test_too_long_route_says_so(district, course_links):
    with pytest.raises(RouteError, match="raise n_links"):
        route_between(district, 0, goal=course_links[-1], params=RouteParams(n_links=8))
