import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.geometry import boxes
from urbanjax.numerics.soft import Relaxation


def made(position, heading, length, width):
    return boxes.box(position, heading, length=length, width=width)


def pair(*arguments):
    return made(*arguments[:4]), made(*arguments[4:])


gap = jax.jit(lambda *pairs: boxes.box_gap(*pair(*pairs)))
soft_gap = jax.jit(lambda *pairs, temperature: boxes.soft_box_gap(*pair(*pairs), temperature=temperature))
overlap = jax.jit(lambda *pairs: boxes.overlap(*pair(*pairs)))
corners = jax.jit(lambda *one: boxes.corners(made(*one)))


def random_pairs(n, seed=0):
    """Arguments of `pair` for n pairs in double precision; in the second half b lies within 0.5 m of touching a."""
    rng = np.random.default_rng(seed)
    a = [rng.uniform(-20, 20, (n, 2)), rng.uniform(-4, 4, n), rng.uniform(0.5, 12, n), rng.uniform(0.5, 3, n)]
    b = [rng.uniform(-20, 20, (n, 2)), rng.uniform(-4, 4, n), rng.uniform(0.5, 12, n), rng.uniform(0.5, 3, n)]
    bearing = rng.uniform(-np.pi, np.pi, n)
    towards = np.stack([np.cos(bearing), np.sin(bearing)], -1)
    near, far = np.zeros(n), np.full(n, 40.0)
    wanted = rng.uniform(-0.5, 0.5, n)
    for _ in range(60):
        middle = (near + far) / 2
        outside = np.asarray(gap(*a, a[0] + middle[:, None] * towards, *b[1:])) > wanted
        near, far = np.where(outside, near, middle), np.where(outside, middle, far)
    b[0][n // 2 :] = (a[0] + far[:, None] * towards)[n // 2 :]
    return [*a, *b]


def euclidean(one, other):
    """Distance between two disjoint convex polygons: the closest corner to edge, either way round."""
    best = np.inf
    for points, polygon in ((one, other), (other, one)):
        start, edge = polygon, np.roll(polygon, -1, axis=0) - polygon
        along = np.sum((points[:, None] - start) * edge, -1) / np.sum(edge**2, -1)
        foot = start + np.clip(along, 0, 1)[..., None] * edge
        best = min(best, np.linalg.norm(points[:, None] - foot, axis=-1).min())
    return best


def polygons(arguments):
    return np.asarray(corners(*arguments[:4])), np.asarray(corners(*arguments[4:]))


@pytest.mark.parametrize(
    ("position", "heading", "expected"),
    [
        ((7.0, 0.0), 0.0, 3.0),  # in line: bumper to bumper
        ((0.0, 3.0), 0.0, 1.0),  # side by side
        ((0.0, 4.0), np.pi / 2, 1.0),  # across, beside
        ((4.0, 0.0), 0.0, 0.0),  # touching
        ((3.5, 0.5), 0.0, -0.5),  # the shortest way out is back
        ((0.0, 0.0), 0.0, -2.0),  # coincident: the shortest way out is sideways
        ((7.0, 9.0), 0.0, 7.0),  # corner to corner: less than the distance
    ],
)
def test_known_gaps(position, heading, expected):
    a = (jnp.zeros(2), jnp.zeros(()), jnp.asarray(4.0), jnp.asarray(2.0))
    b = (jnp.asarray(position), jnp.asarray(heading), jnp.asarray(4.0), jnp.asarray(2.0))
    np.testing.assert_allclose(gap(*a, *b), expected, atol=1e-6)


def test_corners_run_counter_clockwise_from_the_front_left(x64):
    found = boxes.corners(made(jnp.array([1.0, 2.0]), jnp.asarray(np.pi / 2), jnp.asarray(4.0), jnp.asarray(2.0)))
    np.testing.assert_allclose(found, [[0, 4], [0, 0], [2, 0], [2, 4]], atol=1e-12)


def test_sign_equals_highway_envs_separating_axes(x64):
    from highway_env.utils import are_polygons_intersecting

    arguments = random_pairs(10_000)
    found = np.asarray(gap(*arguments))
    assert (np.abs(found[5000:]) <= 0.5 + 1e-9).all()
    still = np.zeros(2)
    closed = [np.concatenate([points, points[:, :1]], axis=1) for points in polygons(arguments)]
    peer = np.array([are_polygons_intersecting(a, b, still, still)[0] for a, b in zip(*closed, strict=True)])
    assert 0.2 < peer.mean() < 0.8
    np.testing.assert_array_equal(np.asarray(overlap(*arguments)), peer)


def test_positive_gap_is_a_tight_lower_bound_of_the_distance(x64):
    arguments = random_pairs(600, seed=1)
    found = np.asarray(gap(*arguments))
    apart = found > 0
    distance = np.array([euclidean(a, b) for a, b in zip(*polygons(arguments), strict=True)])[apart]
    assert (found[apart] <= distance + 1e-9).all()
    assert (np.abs(found[apart] - distance) < 1e-9).mean() > 0.3


def test_negative_gap_is_the_shortest_move_that_parts_the_boxes(x64):
    arguments = random_pairs(400, seed=2)
    found = np.asarray(gap(*arguments))
    inside = found < 0
    for angle in np.linspace(-np.pi, np.pi, 60):
        moved = arguments[4] - 0.999 * found[:, None] * [np.cos(angle), np.sin(angle)]
        assert (np.asarray(gap(*arguments[:4], moved, *arguments[5:]))[inside] < 0).all()
    outward = jax.grad(lambda p: gap(*arguments[:4], p, *arguments[5:]).sum())(arguments[4])
    moved = arguments[4] - found[:, None] * outward
    np.testing.assert_allclose(np.asarray(gap(*arguments[:4], moved, *arguments[5:]))[inside], 0, atol=1e-9)


@pytest.mark.parametrize("function", [gap, lambda *a: soft_gap(*a, temperature=0.2)], ids=["hard", "soft"])
def test_gap_is_symmetric_and_invariant_under_motion_mirror_and_turning_round(x64, function):
    arguments = random_pairs(200, seed=3)
    pa, ha, la, wa, pb, hb, lb, wb = arguments
    reference = function(*arguments)
    rotation = np.array([[np.cos(1.1), -np.sin(1.1)], [np.sin(1.1), np.cos(1.1)]])
    shift, mirror = np.array([5.0, -7.0]), np.array([1.0, -1.0])
    for other in (
        (pb, hb, lb, wb, pa, ha, la, wa),
        (pa @ rotation.T + shift, ha + 1.1, la, wa, pb @ rotation.T + shift, hb + 1.1, lb, wb),
        (pa * mirror, -ha, la, wa, pb * mirror, -hb, lb, wb),
        (pa, ha + np.pi, la, wa, pb, hb, lb, wb),
        (pa, ha + np.pi / 2, wa, la, pb, hb, lb, wb),
    ):
        np.testing.assert_allclose(function(*other), reference, atol=1e-10)


def test_soft_gap_keeps_its_bounds_and_tends_to_the_gap(x64):
    arguments = random_pairs(1000, seed=4)
    hard = np.asarray(gap(*arguments))
    for temperature in (1.0, 0.1, 1e-4):
        found = np.asarray(soft_gap(*arguments, temperature=temperature))
        assert (found >= hard - temperature - 1e-9).all()
        assert (found <= hard + temperature * (np.log(4) + 0.5) + 1e-9).all()


@pytest.mark.parametrize("which", range(8))
def test_gradients_equal_finite_differences(x64, which):
    arguments = random_pairs(40, seed=5)
    direction = np.random.default_rng(6).normal(size=np.shape(arguments[which]))

    def moved(function, step):
        changed = list(arguments)
        changed[which] = jnp.asarray(arguments[which] + step * direction)
        return function(*changed)

    for function, share in ((lambda *a: soft_gap(*a, temperature=0.2), 1.0), (gap, 0.95)):  # the hard gap has kinks
        _, slope = jax.jvp(lambda step, f=function: moved(f, step), (0.0,), (1.0,))
        step = 1e-6
        expected = (moved(function, step) - moved(function, -step)) / (2 * step)
        assert (np.abs(slope - expected) < 1e-6).mean() >= share


def test_the_gradient_by_the_temperature_equals_finite_differences(x64):
    arguments = random_pairs(40, seed=7)
    step = 1e-6
    for temperature in (0.1, 2.0):
        _, slope = jax.jvp(lambda t: soft_gap(*arguments, temperature=t), (temperature,), (1.0,))
        up, down = (soft_gap(*arguments, temperature=temperature + sign * step) for sign in (1, -1))
        np.testing.assert_allclose(slope, (up - down) / (2 * step), atol=1e-6)


@pytest.mark.parametrize("mode", ["hard", "soft", "straight_through"])
def test_gradient_is_finite_for_coincident_parallel_and_empty_boxes(mode):
    def value(pa, ha, la, wa, pb, hb, lb, wb):
        return boxes.relaxed_box_gap(*pair(pa, ha, la, wa, pb, hb, lb, wb), relaxation=Relaxation(0.1, mode)).sum()

    positions = jnp.array([[0.0, 0.0], [0.0, 0.0], [5.0, 0.0], [0.0, 2.0]])
    zero, length, width = jnp.zeros(4), jnp.array([4.0, 0.0, 4.0, 4.0]), jnp.array([2.0, 0.0, 2.0, 2.0])
    arguments = (jnp.zeros((4, 2)), zero, length, width, positions, zero, length, width)
    assert np.isfinite(value(*arguments))
    for slope in jax.grad(value, argnums=range(8))(*arguments):
        assert np.isfinite(slope).all()


def test_modes_and_broadcasting_of_the_relaxed_gap():
    a = made(jnp.zeros((3, 1, 2)), jnp.array([[0.0], [0.5], [1.0]]), jnp.asarray(4.0), jnp.asarray(2.0))
    b = made(jnp.array([[[5.0, 1.0], [0.0, 6.0]]]), jnp.zeros((1, 2)), jnp.asarray(4.0), jnp.asarray(2.0))
    hard = boxes.relaxed_box_gap(a, b, relaxation=Relaxation())
    assert hard.shape == (3, 2)
    np.testing.assert_array_equal(hard, boxes.box_gap(a, b))
    through = boxes.relaxed_box_gap(a, b, relaxation=Relaxation(0.2, "straight_through"))
    np.testing.assert_allclose(through, hard, rtol=1e-6)
    warm = boxes.relaxed_box_gap(a, b, relaxation=Relaxation(0.1, "soft"), scale=2.0)
    np.testing.assert_array_equal(warm, boxes.soft_box_gap(a, b, temperature=0.2))


def test_the_derivative_of_the_soft_gap_is_that_of_its_formula(x64):
    rng = np.random.default_rng(5)

    def some(*shape):
        heading = rng.uniform(-3, 3, shape)
        heading[..., 0] = 0.0  # parallel ones among them
        place = rng.normal(size=(2, *shape)) * 4
        sizes = rng.uniform(1, 3, shape), rng.uniform(0.5, 1.2, shape)
        return boxes.Box(*(jnp.asarray(x) for x in (*place, np.cos(heading), np.sin(heading), *sizes)))

    pair = some(60, 1), some(1, 7)
    leaves, structure = jax.tree.flatten((*pair, jnp.asarray(0.2)))
    along = [jnp.asarray(rng.normal(size=leaf.shape)) for leaf in leaves]

    @jax.jit
    def gap(shift):
        a, b, width = jax.tree.unflatten(structure, [x + shift * d for x, d in zip(leaves, along, strict=True)])
        return boxes.soft_box_gap(a, b, temperature=width)

    step = 1e-6
    _, slope = jax.jvp(gap, (0.0,), (1.0,))
    difference = (np.asarray(gap(step)) - np.asarray(gap(-step))) / (2 * step)
    np.testing.assert_allclose(slope, difference, rtol=1e-6, atol=1e-7)
