import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import cKDTree

from urbanjax.geometry.boxes import box, box_gap
from urbanjax.roadmap.builders import curve, district, intersection
from urbanjax.roadmap.builders.specs import RoadStyle
from urbanjax.sim.scenery.footprints import clearance
from urbanjax.sim.scenery.plots import STYLES
from urbanjax.sim.scenery.roadside import roadsides
from urbanjax.sim.scenery.scenery import altered, furnish


@pytest.fixture(scope="module")
def graph():
    return district()


@pytest.fixture(scope="module")
def surroundings(graph):
    return jax.device_get(furnish(graph))


def off_the_road(graph, s):
    """Least distance [m] of furniture from any point of a lane: rectangles against a grid of points 0.9 m apart."""
    left, right = (np.asarray(side, float)[np.asarray(graph.valid)] for side in (graph.left, graph.right))
    where = np.linspace(0, left.shape[1] - 1, 4 * left.shape[1])
    at = where.astype(int).clip(0, left.shape[1] - 2)
    rest = (where - at)[:, None]
    left, right = (side[:, at] * (1 - rest) + side[:, at + 1] * rest for side in (left, right))
    share = np.linspace(0, 1, 5)[:, None]
    points = (left[:, :, None] * share + right[:, :, None] * (1 - share)).reshape(-1, 2)
    near = cKDTree(points).query_ball_point(s.centre, np.hypot(*s.half.T) + 4.0)
    owner, point = np.repeat(np.arange(len(near)), [len(some) for some in near]), np.concatenate(near).astype(int)
    away, half = points[point] - s.centre[owner], s.half[owner]
    cos, sin = np.cos(s.heading[owner]), np.sin(s.heading[owner])
    along, across = away[:, 0] * cos + away[:, 1] * sin, away[:, 1] * cos - away[:, 0] * sin
    dx, dy = np.maximum(np.abs(along) - half[:, 0], 0), np.maximum(np.abs(across) - half[:, 1], 0)
    least = np.full(len(near), np.inf)
    np.minimum.at(least, owner, np.hypot(dx, dy))
    return least


@pytest.fixture(scope="module")
def distance(graph, surroundings):
    return off_the_road(graph, surroundings)


def test_nothing_stands_on_or_close_to_a_lane(surroundings, distance):
    assert distance.min() >= 1.5
    building = (surroundings.half[:, 1] > 3.0) & (surroundings.bottom == 0)
    assert building.sum() > 200
    assert distance[building].min() >= 3.0


def test_clearance_is_the_distance_or_a_little_less(graph, surroundings, distance):
    sure = clearance(graph, surroundings.centre, heading=surroundings.heading, half=surroundings.half)
    near = distance < 4.0
    assert (sure[near] <= distance[near]).all()
    assert (distance - sure)[near].max() < 0.3


def test_course_is_furnished_all_along(graph, surroundings):
    assert 1500 < len(surroundings.top) < 4000
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(surroundings))
    assert (surroundings.top > surroundings.bottom).all()
    assert ((surroundings.reflectivity > 0) & (surroundings.reflectivity <= 1)).all()
    places = np.asarray(graph.centre)[:, 15]
    near = np.linalg.norm(places[:, None] - surroundings.centre[None], axis=-1) < 60
    assert near.sum(axis=1).min() > 15


def test_both_sides_of_every_road_are_found_once():
    sides = roadsides(
        curve(radius=60.0, angle=1.2, n_lanes=2, lead=50.0, transition=20.0, style=RoadStyle(section=40.0))
    )
    assert sorted(side.outward for side in sides) == [-1.0, 1.0]
    for side in sides:
        assert (np.diff(side.station) > 0).all()
    station = np.array([10.0, 80.0])
    (left, right) = (side.at(station, np.array([2.0, 2.0]))[0] for side in sorted(sides, key=lambda s: -s.outward))
    np.testing.assert_allclose(left[0, 1] - right[0, 1], 2 * 3.5 + 4.0, atol=1e-3)


def test_solid_things_do_not_stand_in_each_other(surroundings):
    s = surroundings
    solid = np.flatnonzero((s.half.min(1) > 0.7) & (s.bottom < 0.3))
    c, h, f = jnp.asarray(s.centre[solid]), jnp.asarray(s.heading[solid]), jnp.asarray(s.half[solid])
    near = np.triu(np.linalg.norm(s.centre[solid][:, None] - s.centre[solid][None], axis=-1) < 60, 1)
    a, b = np.nonzero(near)
    one, other = (box(c[k], h[k], length=2 * f[k, 0], width=2 * f[k, 1]) for k in (a, b))
    clash = box_gap(one, other) < -1.0
    assert np.mean(clash) < 1e-3  # but for bays in their house's corner


def test_seed_decides(graph):
    small = intersection()
    first, again, other = furnish(small, 3), furnish(small, 3), furnish(small, 4)
    jax.tree.map(np.testing.assert_array_equal, first, again)
    assert first.centre.shape != other.centre.shape or (first.centre != other.centre).any()


def test_styles_are_distributions():
    for style in STYLES.values():
        assert len(style.plots) == len(style.weights)
        assert sum(style.weights) == pytest.approx(1.0)


def test_altered_share_is_altered_and_still_off_the_road(graph, surroundings):
    wrong = jax.device_get(altered(surroundings, 0.3, seed=1))
    same = np.ones(len(surroundings.top), bool)
    for a, b in zip(jax.tree.leaves(surroundings), jax.tree.leaves(wrong), strict=True):
        same &= (a == b).reshape(len(a), -1).all(axis=1)
    assert 1 - same.mean() == pytest.approx(0.3, abs=0.001)
    removed = surroundings.valid & ~wrong.valid
    assert removed.mean() == pytest.approx(0.1, abs=0.01)
    moved = np.linalg.norm(wrong.centre - surroundings.centre, axis=-1)
    assert moved[moved > 0].min() > 1.99
    assert moved.max() < 8.01
    assert np.mean(off_the_road(graph, jax.device_get(wrong)) < 0.3) < 0.003
