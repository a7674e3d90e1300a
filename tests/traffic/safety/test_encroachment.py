import jax
import numpy as np
import pytest

from tests.traffic.safety.scenes import drive, meet, objects, outline, random_objects
from urbanjax.traffic.safety.encroachment import conflict_area, encroachments, post_encroachment_time

DT, COUNT = 0.2, 25
one_pair = jax.jit(lambda a, b: post_encroachment_time(a, b, dt=DT, window=COUNT))
pet_of, area_of = jax.jit(post_encroachment_time, static_argnames="window"), jax.jit(conflict_area)
area = jax.jit(lambda a, b: conflict_area(a, b, dt=DT))


def winding(seed, n):
    """Tracks [T, n] that turn at a constant rate through the middle, some samples missing."""
    rng = np.random.default_rng(seed)
    start = random_objects(rng, (n,), 20.0)
    time = np.arange(COUNT)[:, None] * DT
    rate = rng.uniform(-0.5, 0.5, n)
    heading = np.asarray(start.heading) + rate * time
    steps = np.stack([np.cos(heading), np.sin(heading)], -1) * np.asarray(start.speed)[:, None] * DT
    position = np.asarray(start.position) + np.cumsum(steps, axis=0)
    full = [np.broadcast_to(x, heading.shape) for x in (start.speed, start.length, start.width)]
    return objects(position, heading, *full, valid=rng.random(heading.shape) < 0.9)


def overlaps(a, b):
    """Which sample of a meets which sample of b, [T, T], by polygons."""
    shapes_a, shapes_b = outline(a), outline(b)
    return meet(shapes_a[:, None], shapes_b[None]) & np.asarray(a.valid)[:, None] & np.asarray(b.valid)[None]


def brute_pet(matrix):
    lags = [j - i for i, j in zip(*np.nonzero(matrix), strict=True) if j >= i]
    return min(lags) * DT if lags else np.inf


@pytest.fixture(scope="module")
def tracks():
    return winding(0, 11)


@pytest.fixture(scope="module")
def table(tracks):
    return np.array([[overlaps(vehicle(tracks, i), vehicle(tracks, j)) for j in range(11)] for i in range(11)])


def vehicle(tree, i):
    """Vehicle i of tracks: its fields [T]."""
    return jax.tree.map(lambda x: x[:, i], tree)


def test_pet_is_the_least_lag_of_overlapping_footprints(tracks, table):
    found = np.array([[one_pair(vehicle(tracks, i), vehicle(tracks, j)) for j in range(11)] for i in range(11)])
    expected = np.array([[brute_pet(cell) for cell in row] for row in table])
    positive = expected[np.isfinite(expected)]
    assert (positive > 0).sum() > 5
    assert np.isinf(expected).sum() > 5
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    np.fill_diagonal(expected, np.inf)
    np.testing.assert_allclose(jax.jit(lambda t: encroachments(t, DT, window=COUNT))(tracks), expected, rtol=1e-6)
    within = np.where(expected < 3.5 * DT, expected, np.inf)
    np.testing.assert_allclose(jax.jit(lambda t: encroachments(t, DT, window=3))(tracks), within, rtol=1e-6)


def test_conflict_area_is_what_both_sweep(tracks, table):
    for i, j in ((0, 1), (2, 3), (4, 5), (6, 7), (0, 6), (1, 4)):
        found = area(vehicle(tracks, i), vehicle(tracks, j))
        inside = [np.nonzero(table[i, j].any(axis))[0] for axis in (1, 0)]
        if not len(inside[0]):
            assert np.isinf([*found.enter, *found.leave, found.pet]).all()
            continue
        enter, leave = ([float(x[at]) * DT for x in inside] for at in (0, -1))
        np.testing.assert_allclose([found.enter, found.leave], [enter, leave], rtol=1e-6)
        np.testing.assert_allclose(found.pet, max(enter[1] - leave[0], enter[0] - leave[1]), atol=1e-6)
    assert 10 < sum(cell.any() for row in table for cell in row) - 11 < 99


def crossing(delay, dt, count):
    """One drives along x, one along y at 10 m/s; the second comes `delay` after the first has left the crossing."""
    start = objects([[-20.0, 0.0], [0.0, -23.0 - 10 * delay - 3.0]], [0.0, np.pi / 2], 10.0)
    return (vehicle(drive(start, count, dt), i) for i in range(2))


def test_a_crossing_at_right_angles_has_the_pet_of_geometry():
    # The first one has left the square |x|, |y| <= 1 after 23 m, the second one's front is there after 23 m + 10 delay.
    for dt, count in ((0.1, 60), (0.025, 240)):
        for delay in (0.33, 1.27):
            first, second = crossing(delay, dt, count)
            point = float(pet_of(first, second, dt=dt, window=count))
            whole = area_of(first, second, dt=dt)
            assert delay <= point + 1e-4
            assert point <= delay + 2 * dt + 1e-4
            np.testing.assert_allclose(whole.pet, point, atol=1e-4)
            assert np.isinf(pet_of(second, first, dt=dt, window=count))


def test_a_collision_has_no_time_between_and_a_follower_its_time_gap():
    same = objects([[0.0, 0.0], [0.0, 0.0], [-16.5, 0.0]], np.zeros(3), 10.0)
    found = encroachments(drive(same, 40, 0.1), 0.1, window=20)
    np.testing.assert_allclose(found, [[np.inf, 0, 1.3], [0, np.inf, 1.3], [np.inf, np.inf, np.inf]], rtol=1e-6)


def test_scenarios_go_through_vmap():
    both = [winding(seed, 3) for seed in (3, 4)]
    stacked = jax.tree.map(lambda *x: np.stack(x), *both)
    found = jax.jit(jax.vmap(lambda t: encroachments(t, DT, window=10)))(stacked)
    few = jax.jit(lambda t: encroachments(t, DT, window=10))
    for one, expected in zip(found, both, strict=True):
        np.testing.assert_allclose(one, few(expected), rtol=1e-6)
