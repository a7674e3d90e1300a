"""Finding the lane of a pose: known places, heading gate, continuity, and what is differentiable."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.roadmap import links
from urbanjax.roadmap.graph import RoadType
from urbanjax.roadmap.locate import LocateParams, follow, locate, misfit, onwards
from urbanjax.roadmap.padding import GraphSize, pad
from urbanjax.types import RoadError

locate_jit = jax.jit(locate)
follow_jit = jax.jit(follow)
sample_jit = jax.jit(links.sample)
N = 64


def poses(graph, link, station, offset):
    point = sample_jit(graph, jnp.asarray(link, jnp.int32), station=jnp.asarray(station, jnp.float32))
    normal = jnp.stack([-jnp.sin(point.heading), jnp.cos(point.heading)], -1)
    return point.position + jnp.asarray(offset, jnp.float32)[:, None] * normal, point.heading


def by_area(graph, name):
    return int(np.flatnonzero(np.asarray(graph.area) == graph.area_names.index(name))[0])


def test_poses_on_lanes_are_found_with_station_and_offset(district):
    rng = np.random.default_rng(0)
    link = rng.choice(np.flatnonzero(np.asarray(district.road_type) != RoadType.JUNCTION), N)
    station = rng.uniform(0.02, 0.98, N) * np.asarray(district.length)[link]
    offset = rng.uniform(-1.5, 1.5, N)
    position, heading = poses(district, link, station, offset)
    found = locate_jit(district, position, heading=heading + 0.2)
    np.testing.assert_array_equal(found.link, link)
    np.testing.assert_allclose(found.station, station, atol=2e-3)
    np.testing.assert_allclose(found.offset, offset, atol=2e-3)
    np.testing.assert_allclose(found.heading_error, 0.2, atol=1e-4)
    np.testing.assert_allclose(found.distance, np.abs(offset), atol=2e-3)
    assert np.all(found.valid)


def test_few_candidates_find_what_all_find(district):
    rng = np.random.default_rng(1)
    corners = np.asarray(district.centre)[rng.integers(0, len(district.length), N), rng.integers(0, 32, N)]
    position = jnp.asarray(corners + rng.normal(0, 2.0, (N, 2)), jnp.float32)
    heading = jnp.asarray(rng.uniform(-np.pi, np.pi, N), jnp.float32)
    few = locate_jit(district, position, heading=heading)
    every = locate_jit(
        district, position, heading=heading, previous=None, params=LocateParams(candidates=len(district.length))
    )
    np.testing.assert_array_equal(few.link, every.link)


def test_without_continuity_the_least_misfit_is_what_is_located(district):
    rng = np.random.default_rng(2)
    position = jnp.asarray(np.asarray(district.centre)[rng.integers(0, len(district.length), N), 7] + 1.0)
    heading = jnp.asarray(rng.uniform(-np.pi, np.pi, N), jnp.float32)
    fit = jax.jit(misfit)(district, position, heading=heading, params=LocateParams())
    every = locate_jit(
        district, position, heading=heading, previous=None, params=LocateParams(candidates=len(district.length))
    )
    np.testing.assert_allclose(fit[jnp.arange(N), every.link], fit.min(1), atol=1e-4)


def test_heading_tells_the_two_directions_of_a_road_apart(graphs):
    graph = graphs["coinciding"]
    position = jnp.array([[50.0, 3.5], [50.0, 3.5]])
    found = locate_jit(graph, position, heading=jnp.array([0.1, np.pi - 0.1]))
    assert found.link.tolist() == [0, 2]
    np.testing.assert_allclose(found.heading_error, [0.1, -0.1], atol=1e-5)


def test_wrong_way_driver_is_still_on_the_only_lane(road):
    found = locate_jit(road, jnp.array([[50.0, 0.0]]), heading=jnp.array([3.0]))
    assert int(found.link[0]) == 2
    assert bool(found.valid[0])
    assert float(found.heading_error[0]) == pytest.approx(3.0)


def test_poses_off_the_road_are_invalid(road):
    found = locate_jit(road, jnp.array([[50.0, -30.0], [-40.0, 0.0]]), heading=jnp.zeros(2))
    assert not np.any(found.valid)
    assert np.all(np.isfinite(found.station))


def test_crossing_traffic_does_not_steal_a_vehicle(crossing):
    """Driving straight over the intersection, a vehicle stays on its lane at every crossing lane."""
    path = [by_area(crossing, name) for name in ("west in", "west straight", "east out")]
    located, seen = None, []
    for x in np.arange(-25.0, 25.0, 0.5):
        position = jnp.array([[x, -1.75]], jnp.float32)
        located = locate_jit(crossing, position, heading=jnp.zeros(1), previous=located)
        seen.append(int(located.link[0]))
    assert list(dict.fromkeys(seen)) == path


def test_hysteresis_keeps_the_lane_until_the_other_is_clearly_nearer(road):
    def drive(offsets):
        located, seen = None, []
        for y in offsets:
            located = locate_jit(road, jnp.array([[50.0, y]], jnp.float32), heading=jnp.zeros(1), previous=located)
            seen.append(int(located.link[0]))
        return seen

    up = drive(np.arange(0.0, 3.5, 0.1))
    down = drive(np.arange(3.5, 0.0, -0.1))
    assert up.index(1) * 0.1 == pytest.approx(2.0, abs=0.15)
    assert 3.5 - down.index(2) * 0.1 == pytest.approx(1.5, abs=0.15)


def test_a_pose_is_followed_to_neighbours_and_successors_with_hysteresis(road):
    ways, params = onwards(road), LocateParams()

    def link(previous, x, y, heading=0.0):
        start = jnp.asarray(previous, jnp.int32)
        where = jnp.asarray([x, y], jnp.float32)
        return int(follow_jit(road, start, ways=ways, position=where, heading=jnp.float32(heading), params=params))

    assert link(2, 50.0, 0.1) == link(2, 50.0, 1.95) == link(1, 50.0, 1.45) == 2
    assert link(2, 50.0, 2.05) == link(1, 50.0, 1.55) == 1
    assert link(2, 101.0, 0.2) == road.successor[2, 0]
    assert link(2, 50.0, 0.1, heading=2.0) == 2


def test_where_a_pose_can_be_it_is_followed_to_what_is_located(district):
    rng = np.random.default_rng(3)
    link = rng.choice(np.flatnonzero(np.asarray(district.road_type) != RoadType.JUNCTION), N)
    station = rng.uniform(0.02, 0.98, N) * np.asarray(district.length)[link]
    position, heading = poses(district, link, station, rng.uniform(-1.0, 1.0, N))
    params = LocateParams()
    ways = onwards(district)
    each = jax.jit(jax.vmap(lambda k, p, h: follow(district, k, ways=ways, position=p, heading=h, params=params)))
    found = locate_jit(district, position, heading=heading).link
    np.testing.assert_array_equal(each(found, position, heading), found)
    has = np.asarray(district.has_predecessor[found, 0])
    before = jnp.where(has, district.predecessor[found, 0], found).astype(jnp.int32)
    np.testing.assert_array_equal(each(before, position, heading), found)


@pytest.mark.parametrize("offset", [-0.3, 0.3])
def test_a_wrong_way_of_a_fork_is_left_when_the_right_one_shows(crossing, offset):
    """Beside the centre on either side, where another way of the fork is nearer at first."""
    params, forks = LocateParams(), np.flatnonzero(np.asarray(crossing.has_successor).sum(1) > 1)
    table = onwards(crossing)
    step = jax.jit(jax.vmap(lambda k, p, h: follow(crossing, k, ways=table, position=p, heading=h, params=params)))
    ways = [(int(a), int(b)) for a in forks for b in crossing.successor[a][np.asarray(crossing.has_successor[a])]]
    link, goal = (np.array(column, np.int32) for column in zip(*ways, strict=True))
    now = jnp.asarray(link)
    for share in np.linspace(0.0, 0.95, 60):
        at, heading = poses(crossing, goal, share * np.asarray(crossing.length)[goal], np.full(len(goal), offset))
        now = step(now, at, heading - np.sign(offset) * 0.02)
    np.testing.assert_array_equal(now, goal)


def test_station_and_offset_have_exact_gradients(district, course_links, x64):
    graph = jax.tree.map(lambda x: jnp.asarray(x, float) if jnp.issubdtype(x.dtype, jnp.floating) else x, district)
    bend = next(i for i in course_links if district.area_names[int(district.area[i])] == "curve F")
    point = sample_jit(graph, jnp.asarray(bend), station=jnp.asarray(20.3))
    position = point.position + 1.2 * jnp.stack([-jnp.sin(point.heading), jnp.cos(point.heading)])

    @jax.jit
    def values(p):
        found = locate(graph, p[None], heading=point.heading[None])
        return jnp.stack([found.station[0], found.offset[0], found.heading_error[0]])

    jacobian = jax.jit(jax.jacobian(values))(position)
    for k in range(2):
        shift = 1e-5 * jnp.eye(2)[k]
        central = (values(position + shift) - values(position - shift)) / 2e-5
        np.testing.assert_allclose(jacobian[:, k], central, rtol=1e-4, atol=1e-7)


def test_padding_links_are_never_found(road):
    more = pad(road, size=GraphSize(n_links=9))
    position = jnp.array([[20.0, 7.0], [120.0, 0.1]])
    a, b = (locate_jit(graph, position, heading=jnp.zeros(2)) for graph in (road, more))
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        np.testing.assert_array_equal(x, y)


def test_what_can_be_reached_at_once_is_stated_once(road, crossing):
    plain = onwards(road)
    assert plain.link.shape == (6, 4)  # itself, two beside, one ahead
    found = onwards(crossing)
    for k in range(32):
        there = np.asarray(found.link[k])[np.asarray(found.exists[k])]
        assert len(set(there.tolist())) == len(there)
        ahead = np.asarray(crossing.successor[k])[np.asarray(crossing.has_successor[k])]
        assert {k, *ahead.tolist()} <= set(there.tolist())
    with pytest.raises(RoadError, match="raise the number"):
        onwards(crossing, 4)
