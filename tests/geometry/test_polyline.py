import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.geometry import polyline

project = jax.jit(polyline.project)
project_all_masked = jax.jit(
    lambda points, queries, mask: jax.vmap(lambda query: polyline.project(points, query, mask=mask))(queries)
)
project_all = jax.jit(jax.vmap(polyline.project, (None, 0)))
arc_length, headings, curvatures = map(jax.jit, (polyline.arc_length, polyline.headings, polyline.curvatures))
interpolate, resample = jax.jit(polyline.interpolate), jax.jit(polyline.resample, static_argnums=1)
CORNER = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])


def wandering(n=12, seed=0):
    """A polyline of n points in double precision that turns by up to 60 degrees at each vertex."""
    rng = np.random.default_rng(seed)
    direction = np.cumsum(rng.uniform(-1.0, 1.0, n - 1))
    steps = rng.uniform(1, 6, (n - 1, 1)) * np.stack([np.cos(direction), np.sin(direction)], -1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, 0)])


def nearest_by_hand(points, query):
    """(distance, station, signed offset) of the nearest point, one segment at a time."""
    best, station = (np.inf, 0.0, 0.0), 0.0
    for a, b in itertools.pairwise(points):
        length = np.linalg.norm(b - a)
        direction = (b - a) / length
        along = np.clip((query - a) @ direction, 0, length)
        miss = query - a - along * direction
        side = direction[0] * miss[1] - direction[1] * miss[0]
        if np.linalg.norm(miss) < best[0]:
            best = (np.linalg.norm(miss), station + along, np.sign(side) * np.linalg.norm(miss))
        station += length
    return best


def circle(angles, radius=20.0):
    return radius * np.stack([np.cos(angles), np.sin(angles)], -1)


@pytest.mark.parametrize(
    ("query", "station", "offset", "heading", "distance"),
    [
        ((4.0, 3.0), 4.0, 3.0, (-0.25 + 0.4 * 0.5) * np.pi, 3.0),  # left of the first segment
        ((10.0, 0.0), 10.0, 0.0, np.pi / 4, 0.0),  # on the vertex
        ((13.0, -4.0), 10.0, -5.0, np.pi / 4, 5.0),  # in the wedge outside the corner
        ((12.0, 5.0), 15.0, -2.0, np.pi / 2, 2.0),  # right of the second segment
        ((-3.0, 4.0), 0.0, 4.0, -np.pi / 4, 5.0),  # before the start: the offset is the lateral part
        ((9.0, 13.0), 20.0, 1.0, 3 * np.pi / 4, np.sqrt(10)),  # past the end
    ],
)
def test_known_projections_on_a_corner(query, station, offset, heading, distance):
    found = project(jnp.asarray(CORNER), jnp.asarray(query))
    np.testing.assert_allclose(
        [found.station, found.offset, found.heading, found.distance],
        [station, offset, heading, distance],
        atol=1e-5,
    )


def test_projection_is_the_nearest_point(x64):
    for seed in range(5):
        points = wandering(seed=seed)
        queries = np.random.default_rng(seed).uniform(points.min(0) - 8, points.max(0) + 8, (200, 2))
        found = project_all(points, queries)
        expected = np.array([nearest_by_hand(points, q) for q in queries])
        np.testing.assert_allclose(found.distance, expected[:, 0], atol=1e-10)
        np.testing.assert_allclose(found.station, expected[:, 1], atol=1e-9)
        inside = (found.station > 1e-6) & (found.station < arc_length(jnp.asarray(points))[-1] - 1e-6)
        np.testing.assert_allclose(found.offset[inside], expected[inside, 2], atol=1e-9)
        np.testing.assert_allclose(np.linalg.norm(queries - found.position, axis=1), found.distance, atol=1e-9)


def test_everything_is_continuous_past_vertices_and_ends(x64):
    angles = np.linspace(0, 2.0, 9)
    points, offset = circle(angles), -3.0  # outside of a left turn: right of it, where vertices cast wedges
    sweep = np.linspace(-0.3, 2.3, 20_001)
    found = project_all(points, circle(sweep, 20.0 - offset))
    for value, bound in (
        (found.station, 2.0),
        (found.heading, 0.2),
        (found.curvature, 0.01),
        (found.position[:, 0], 2.0),
    ):
        assert np.abs(np.diff(value)).max() < bound * 26 * (sweep[1] - sweep[0])
    middle = (sweep > 0) & (sweep < 2)
    assert (np.diff(found.station)[middle[1:]] >= -1e-12).all()
    assert np.abs(found.offset[middle] - offset).max() < 0.2
    assert np.abs(np.diff(found.offset)).max() < 2 * 23 * (sweep[1] - sweep[0])


def test_circle_has_its_heading_and_curvature(x64):
    angles = np.linspace(-1.0, 6.0, 30)  # more than a turn: unwrapped
    points = jnp.asarray(circle(angles))
    np.testing.assert_allclose(headings(points) - headings(points)[0], angles + 1, atol=1e-9)
    np.testing.assert_allclose(np.cos(headings(points)), -np.sin(angles), atol=1e-9)
    np.testing.assert_allclose(curvatures(points), 1 / 20, atol=1e-9)
    np.testing.assert_allclose(curvatures(points[::-1]), -1 / 20, atol=1e-9)


def test_headings_of_uneven_points_on_a_circle_are_close(x64):
    angles = np.sort(np.random.default_rng(0).uniform(0, 2, 40))
    found = headings(jnp.asarray(circle(angles)))
    np.testing.assert_allclose(found, angles + np.pi / 2, atol=1e-3)
    np.testing.assert_allclose(curvatures(jnp.asarray(circle(angles))), 1 / 20, atol=1e-7)


def test_repeated_and_masked_points_change_nothing(x64):
    points = wandering()
    repeats = np.array([2, 1, 3, 1, 1, 2, 1, 1, 1, 1, 2, 4])
    index = np.repeat(np.arange(12), repeats)
    padded = jnp.asarray(np.concatenate([points[index], [[99.0, 99.0], [-5.0, 3.0]]]))
    mask = jnp.arange(padded.shape[0]) < index.size
    for function in (arc_length, headings, curvatures):
        expected = function(jnp.asarray(points))
        np.testing.assert_allclose(function(padded, mask)[: index.size], expected[index], atol=1e-12)
    queries = np.random.default_rng(1).uniform(points.min(0) - 5, points.max(0) + 5, (60, 2))
    found = project_all_masked(padded, queries, mask)
    expected = project_all(points, queries)
    for name in ("station", "offset", "heading", "curvature", "position", "distance"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-9, err_msg=name)


def test_projection_is_invariant_under_motion_and_mirror(x64):
    points, turn = wandering(seed=3), 0.7
    queries = np.random.default_rng(3).uniform(points.min(0) - 3, points.max(0) + 3, (50, 2))
    reference = project_all(points, queries)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    moved = project_all(points @ rotation.T + 3.0, queries @ rotation.T + 3.0)
    mirrored = project_all(points * [1, -1], queries * [1, -1])
    for other, sign in ((moved, 1), (mirrored, -1)):
        np.testing.assert_allclose(other.station, reference.station, atol=1e-9)
        np.testing.assert_allclose(other.offset, sign * reference.offset, atol=1e-9)
        np.testing.assert_allclose(other.curvature, sign * reference.curvature, atol=1e-9)
    np.testing.assert_allclose(np.exp(1j * (moved.heading - reference.heading)), np.exp(1j * turn), atol=1e-9)
    np.testing.assert_allclose(np.exp(1j * (mirrored.heading + reference.heading)), 1, atol=1e-9)


def test_gradients_equal_finite_differences(x64):
    points = wandering(seed=4)
    rng = np.random.default_rng(4)
    queries, directions = rng.uniform(points.min(0) - 2, points.max(0) + 2, (30, 2)), rng.normal(size=(30, 2))
    bend = rng.normal(size=points.shape)

    @jax.jit
    def moved(step):
        p = jax.vmap(polyline.project, (None, 0))(points + step * bend, queries + step * directions)
        return jnp.stack([p.station, p.offset, p.heading, p.curvature, p.distance])

    step = 1e-6
    _, slope = jax.jvp(moved, (0.0,), (1.0,))
    expected = (moved(step) - moved(-step)) / (2 * step)
    np.testing.assert_allclose(slope, expected, rtol=1e-5, atol=1e-6)
    assert (np.abs(slope).max(axis=1) > 1e-3).all()


def test_offset_on_the_line_has_the_normal_as_gradient():
    normal = jax.jit(jax.vmap(jax.grad(lambda q: polyline.project(jnp.asarray(CORNER), q).offset)))
    np.testing.assert_allclose(normal(jnp.array([[4.0, 0.0], [10.0, 6.0]])), [[0, 1], [-1, 0]], atol=1e-6)


@jax.jit
@jax.value_and_grad
def everything(arguments):
    p = polyline.project(*arguments[:2], mask=jnp.arange(4) < arguments[2])
    return p.station + p.offset + p.heading + p.curvature + p.distance + p.position.sum() + p.fraction


@pytest.mark.parametrize(
    ("points", "allowed"),
    [
        ([[0.0, 0.0]] * 4, 4),
        ([[0.0, 0.0], [0.0, 0.0], [2.0, 0.0], [2.0, 0.0]], 4),
        ([[0.0, 0.0], [2.0, 0.0], [0.0, 0.0], [0.0, 0.0]], 4),
        ([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [10.0, 10.0]], 4),
        ([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [10.0, 10.0]], 0),
    ],
    ids=["one place", "one segment", "there and back", "at a vertex", "nothing allowed"],
)
def test_degenerate_polylines_are_finite_in_value_and_gradient(points, allowed):
    value, slopes = everything((jnp.asarray(points), jnp.asarray(points[1]), float(allowed)))
    assert np.isfinite(value)
    assert all(np.isfinite(slope).all() for slope in slopes)


def test_no_segment_means_the_first_point_and_no_offset():
    found = project(jnp.full((3, 2), 2.0), jnp.array([5.0, 6.0]))
    np.testing.assert_allclose([found.distance, found.station, found.offset, found.heading], [5, 0, 0, 0])
    np.testing.assert_array_equal(found.position, [2, 2])


def test_single_precision_is_good_to_millimetres_far_from_the_origin():
    points = wandering(seed=5) + 5000
    queries = np.random.default_rng(5).uniform(points.min(0) - 3, points.max(0) + 3, (50, 2)).astype(np.float32)
    points = points.astype(np.float32)
    found = project_all(jnp.asarray(points), jnp.asarray(queries))
    expected = np.array([nearest_by_hand(points.astype(float), q.astype(float)) for q in queries])
    np.testing.assert_allclose(found.distance, expected[:, 0], atol=2e-3)


def test_given_vertex_values_are_used():
    points, values = jnp.asarray(CORNER), jnp.array([1.0, 2.0, 4.0])
    found = project(points, jnp.array([10.0, 5.0]), station=values, heading=2 * values, curvature=-values)
    np.testing.assert_allclose([found.station, found.heading, found.curvature], [3, 6, -3], rtol=1e-6)


def test_interpolate_equals_numpy(x64):
    rng = np.random.default_rng(6)
    grid, values = np.sort(rng.uniform(0, 9, 8)), rng.normal(size=(8, 3))
    query = rng.uniform(-1, 10, (4, 5))
    found = interpolate(jnp.asarray(grid), jnp.asarray(values), query=jnp.asarray(query))
    for c in range(3):
        np.testing.assert_allclose(found[..., c], np.interp(query, grid, values[:, c]), atol=1e-12)


def test_resampled_points_are_evenly_spaced_and_keep_the_ends(x64):
    points = jnp.asarray(np.concatenate([CORNER, CORNER[-1:]]))
    found = resample(points, 5)
    np.testing.assert_allclose(found, [[0, 0], [5, 0], [10, 0], [10, 5], [10, 10]], atol=1e-12)
