"""Blocked links, a new route from where the vehicle is, and what is left of a route."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.roadmap.oracle import host, oracle, walked_cost
from urbanjax.roadmap.remaining import remaining
from urbanjax.roadmap.route import RouteParams, Trip, plan_route, reroute, route_between
from urbanjax.types import RouteError, Status

L = 24
plan_route_jit = jax.jit(plan_route)
reroute_jit = jax.jit(reroute)
remaining_jit = jax.jit(remaining)
SMALL = RouteParams(n_links=12)


def links_of(route):
    return np.asarray(route.link)[np.asarray(route.valid)].tolist()


def mask(n, *links):
    return jnp.isin(jnp.arange(n), jnp.array(links, int))


def test_routes_around_blocked_links_cost_what_dijkstra_says(random_graph):
    params, found = RouteParams(n_links=L), 0
    for seed in range(30):
        graph, rng = random_graph(400 + seed), np.random.default_rng(seed)
        start, goal, other = (int(k) for k in rng.choice(22, 3, replace=False))
        free = plan_route_jit(graph, start, trip=Trip(goal, blocked=mask(L)), params=params)
        blocked = {*links_of(free)[1:-1][:1], other}
        route = plan_route_jit(graph, start, trip=Trip(goal, blocked=mask(L, *blocked)), params=params)
        best = oracle(graph, goal, params, blocked=list(blocked))[start]
        if np.isinf(best):
            assert int(route.status) == Status.UNREACHABLE
            continue
        found += best > float(free.cost) * (1 + 1e-5)
        assert not blocked & set(links_of(route))
        assert walked_cost(graph, route, params, list(blocked)) == pytest.approx(best, rel=1e-5)
        assert float(route.cost) == pytest.approx(best, rel=1e-5)
    assert found > 3


def test_who_stands_on_a_blocked_link_leaves_it_by_a_lane_change(road):
    n = len(road.length)
    route = plan_route_jit(road, 0, trip=Trip(3, blocked=mask(n, 0)), params=SMALL)
    assert int(route.status) == Status.OK
    assert links_of(route)[:2] == [0, 1]
    for start, goal, blocked in ((0, 3, (3,)), (3, 3, (3,)), (0, 3, (0, 1))):
        assert int(plan_route_jit(road, start, trip=Trip(goal, blocked=mask(n, *blocked)), params=SMALL).status) == (
            Status.UNREACHABLE
        )


def test_rerouting_on_the_way_without_a_blocked_link_is_the_rest_of_the_route(district, course_links):
    via, goal = (course_links[10], course_links[25]), course_links[40]
    route = plan_route_jit(district, 0, trip=Trip(goal, via))
    whole = links_of(route)
    for entry in (0, 4, whole.index(via[0]), whole.index(via[1]) + 1, len(whole) - 1):
        rest = reroute_jit(district, route, link=whole[entry], station=0.0, trip=Trip(goal, via))
        assert links_of(rest) == whole[entry:]
        np.testing.assert_array_equal(rest.leg[: len(whole) - entry], route.leg[entry : len(whole)])
        part = 0.25 * float(district.length[whole[entry]])
        assert float(
            reroute_jit(district, route, link=whole[entry], station=part, trip=Trip(goal, via)).cost
        ) == pytest.approx(float(rest.cost) - part, abs=1e-2)


def test_passed_via_links_are_not_visited_again(district, course_links):
    via, goal = (course_links[10],), course_links[40]
    route = plan_route_jit(district, 0, trip=Trip(goal, via))
    ahead, closed = course_links[20], course_links[21]
    detour = Trip(goal, via, mask(len(district.length), closed))
    rest = reroute_jit(district, route, link=ahead, station=5.0, trip=detour)
    assert int(rest.status) == Status.OK
    assert closed not in links_of(rest)
    assert via[0] not in links_of(rest)
    assert links_of(rest)[-1] == goal
    again = reroute_jit(district, rest, link=links_of(rest)[2], station=0.0, trip=Trip(goal, via))
    assert via[0] not in links_of(again)
    behind = reroute_jit(district, route, link=course_links[5], station=5.0, trip=detour)
    assert via[0] in links_of(behind)


def test_off_the_route_the_last_entry_tells_what_was_passed(district, course_links):
    graph, via, goal = host(district), (course_links[10],), course_links[40]
    route = plan_route_jit(district, 0, trip=Trip(goal, via))
    beside = int(graph.right_link[course_links[20]])
    assert beside not in links_of(route)
    for since, visits in ((18, False), (3, True)):
        rest = reroute_jit(district, route, link=beside, station=0.0, trip=Trip(goal, via), since=since)
        assert (via[0] in links_of(rest)) == visits
        assert int(rest.status) == Status.OK


def test_laps_that_are_driven_are_not_driven_again(district, course_links):
    n, goal = len(course_links), course_links[-1]
    route = plan_route_jit(district, 0, trip=Trip(goal, laps=3))
    for since, left in ((0, 3 * n - 7), (n, 2 * n - 7), (2 * n, n - 7)):
        rest = reroute_jit(district, route, link=course_links[7], station=0.0, trip=Trip(goal, laps=3), since=since)
        assert links_of(rest) == (3 * course_links)[3 * n - left :]
    back = plan_route_jit(district, 0, trip=Trip(0, laps=2))
    assert links_of(reroute_jit(district, back, link=0, station=0.0, trip=Trip(0, laps=2))) == links_of(back)
    assert (
        links_of(reroute_jit(district, back, link=0, station=0.0, trip=Trip(0, laps=2), since=1)) == links_of(back)[n:]
    )


def test_remaining_way_and_time_along_a_route(road):
    graph = road.replace(speed_limit=jnp.where(jnp.arange(len(road.length)) < 3, 10.0, 20.0))
    route = route_between(graph, 0, goal=5, params=SMALL)
    at_start = remaining_jit(graph, route, link=0, station=0.0)
    assert float(at_start.distance) == pytest.approx(200.0)
    assert float(at_start.time) == pytest.approx(100 / 10 + 100 / 20)
    for link, station, left in ((0, 30.0, 170.0), (5, 30.0, 70.0), (5, 100.0, 0.0)):
        now = remaining_jit(graph, route, link=link, station=station)
        assert bool(now.on_route)
        assert links_of(route)[int(now.entry)] == link
        assert float(now.distance) == pytest.approx(left, abs=1e-3)
        assert float(now.driven) == pytest.approx(200 - left, abs=1e-3)
    gradient = jax.grad(lambda s: remaining(graph, route, link=0, station=s).time)(30.0)
    assert float(gradient) == pytest.approx(-1 / 10)
    aside = next(i for i in range(6) if i not in links_of(route))
    assert not bool(remaining_jit(graph, route, link=aside, station=0.0).on_route)


def test_remaining_way_is_the_cost_to_go_but_for_penalties(district, course_links):
    other = int(district.right_link[course_links[40]])
    route = plan_route_jit(district, 0, trip=Trip(other))
    changes = np.cumsum(np.asarray(route.change)[::-1])[::-1]
    for entry, link in enumerate(links_of(route)):
        now = remaining_jit(district, route, link=link, station=0.0, since=entry)
        rest = reroute_jit(district, route, link=link, station=0.0, trip=Trip(other), since=entry)
        assert float(now.distance) == pytest.approx(float(rest.cost) - 50.0 * changes[entry], rel=1e-4)
    assert changes[0] > 0


def test_laps_are_told_apart_by_the_last_entry(district, course_links):
    route = plan_route_jit(district, 0, trip=Trip(course_links[-1], laps=3))
    one = float(remaining_jit(district, route, link=0, station=0.0).distance) / 3
    for lap in range(3):
        now = remaining_jit(district, route, link=course_links[7], station=1.0, since=lap * len(course_links))
        assert int(now.entry) == lap * len(course_links) + 7
        before = float(np.asarray(district.length)[course_links[:7]].sum())
        assert float(now.driven) == pytest.approx(lap * one + before + 1.0, rel=1e-4)


def test_blocked_links_of_another_graph_are_refused(road):
    with pytest.raises(RouteError, match="give a bool for each of 6 links"):
        route_between(road, 0, goal=5, params=SMALL, blocked=np.zeros(4, bool))
    with pytest.raises(RouteError, match="past the blocked links"):
        route_between(road, 0, goal=5, params=SMALL, blocked=np.arange(6) == 5)
