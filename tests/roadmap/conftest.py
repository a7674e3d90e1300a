"""Road graphs that the tests of this room share."""

import jax
import numpy as np
import pytest

from urbanjax.roadmap import builders
from urbanjax.roadmap.builders.specs import RoadStyle
from urbanjax.roadmap.corridor import CorridorParams, corridor_along, sized, window
from urbanjax.roadmap.padding import GraphSize, pad
from urbanjax.roadmap.progress import progress, sample, to_world
from urbanjax.roadmap.route import RouteParams, route_between


@pytest.fixture(scope="session")
def district():
    return builders.district()


@pytest.fixture(scope="session")
def crossing():
    return builders.intersection(n_points=16)


@pytest.fixture(scope="session")
def road():
    """Two sections of three lanes."""
    return builders.straight(n_lanes=3, length=200.0, style=RoadStyle(section=100.0, n_points=16))


@pytest.fixture(scope="session")
def graphs(district, crossing, road):
    """One graph of each kind."""
    return {
        "straight": road,
        "two_way": builders.two_way(length=200.0, style=RoadStyle(n_points=16)),
        "coinciding": builders.two_way(length=200.0, coinciding=True, style=RoadStyle(n_points=16)),
        "curve": builders.curve(radius=40.0, style=RoadStyle(section=60.0, n_points=16)),
        "merge": builders.merge(before=80.0, parallel=60.0, after=80.0, ramp=60.0, style=RoadStyle(n_points=16)),
        "crossing": crossing,
        "roundabout": builders.roundabout(leg=60.0, style=RoadStyle(n_points=16)),
        "district": district,
    }


@pytest.fixture(scope="session")
def course_links(district):
    """The links of the district's leftmost lane, in driving direction."""
    successor = np.asarray(district.successor)
    links = [0]
    while (following := int(successor[links[-1], 0])) != 0:
        links.append(following)
    return links


@pytest.fixture(scope="session")
def extend_along():
    """The corridor (256 stations) along the route between two links of a small graph.

    All graphs get one shape and drop what is static, so that `corridor_along` is compiled once for them all.
    """
    compiled = jax.jit(corridor_along)

    def along(graph, start, goal):
        alike = pad(graph, size=GraphSize(n_links=32, n_successors=3, n_relations=8)).replace(
            area_names=("",), n_signals=0
        )
        route = route_between(alike, start, goal=goal, params=RouteParams(n_links=16))
        return compiled(alike, route, params=CorridorParams(n_stations=256, n_stops=4))

    return along


@pytest.fixture(scope="session")
def extend_district(district):
    """The corridor (5632 stations) along a route through the district."""
    compiled = jax.jit(corridor_along)

    def along(route):
        sizes = sized(district, route, params=CorridorParams()).replace(n_stations=5632)
        return compiled(district, route, params=sizes)

    return along


@pytest.fixture(scope="session")
def corridor_course(district, course_links, extend_district):
    """One lap of the district's leftmost lane."""
    return extend_district(route_between(district, 0, goal=course_links[-1]))


@pytest.fixture(scope="session")
def window_jit():
    return jax.jit(lambda corridor, station, params: window(corridor, station, params=params))


@pytest.fixture(scope="session")
def progress_jit():
    """Progress of many poses."""

    def one(corridor, position, heading):
        return progress(corridor, position, heading=heading)

    return jax.jit(jax.vmap(one, (None, 0, 0)))


@pytest.fixture(scope="session")
def sample_jit():
    return jax.jit(sample)


@pytest.fixture(scope="session")
def to_world_jit():
    return jax.jit(lambda corridor, station, offset: to_world(corridor, station, offset=offset))


@pytest.fixture(scope="session")
def random_graph():
    """Graphs of 24 links, the last two invalid, with random ways on: up to three successors or, in chains, mostly one.

    Arguments: seed, and whether in chains.
    """
    n, most = 24, 3
    lane = builders.LaneSpec("a", np.array([[0.0, 0.0], [10.0, 0.0]]))
    template = builders.assemble([lane], n_points=4, size=GraphSize(n_links=n, n_successors=most))

    def make(seed, chains=False):
        rng = np.random.default_rng(seed)
        n_out = rng.integers(0, most + 1, n)
        left, right = rng.integers(0, n, n), rng.integers(0, n, n)
        out = template.replace(
            valid=np.arange(n) < n - 2,
            length=rng.uniform(5.0, 100.0, n).astype(np.float32),
            speed_limit=rng.uniform(5.0, 20.0, n).astype(np.float32),
            successor=rng.integers(0, n, (n, most)).astype(np.int32),
            has_successor=np.arange(most)[None] < n_out[:, None],
            left_link=left.astype(np.int32),
            has_left=rng.random(n) < 0.4,
            left_change=rng.random(n) < 0.7,
            right_link=right.astype(np.int32),
            has_right=rng.random(n) < 0.4,
            right_change=rng.random(n) < 0.7,
        )
        one_way = rng.random(n) < 0.9
        if chains:
            ring = (np.arange(n, dtype=np.int32) + 1) % (n - 2)
            out = out.replace(
                successor=np.where(one_way[:, None], ring[:, None], out.successor),
                has_successor=np.where(one_way[:, None], np.arange(most)[None] < 1, out.has_successor),
                has_left=out.has_left & ~one_way,
                has_right=out.has_right & ~one_way,
            )
        return out

    return make
