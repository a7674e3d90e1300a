import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.traffic.safety.scenes import meet, objects, outline, pick, random_objects
from urbanjax.traffic.safety.boxes import box_time_to_collision
from urbanjax.traffic.safety.following import time_to_collision

collision = jax.jit(box_time_to_collision)


def pairs(n, seed=0, within=4.0):
    """Boxes of which most meet: they come within a few metres of each other in less than `within` seconds."""
    rng = np.random.default_rng(seed)
    a, b = random_objects(rng, (n,)), random_objects(rng, (n,))
    time, miss = rng.uniform(0, within, (n, 1)), rng.uniform(-6, 6, (n, 2))
    ways = (np.stack([np.cos(o.heading), np.sin(o.heading)], -1) * np.asarray(o.speed)[:, None] for o in (a, b))
    return a, b.replace(position=a.position + (next(ways) - next(ways)) * time + miss)


def shapes_at(tree, times):
    """Outlines [n, 4, 2] of one object at the times."""
    heading = float(tree.heading)
    way = np.array([np.cos(heading), np.sin(heading)]) * float(tree.speed)
    return outline(tree)[None] + times[:, None, None] * way


def test_polygons_meet_then_and_at_no_time_before(x64):
    a, b = pairs(240)
    found = np.asarray(collision(a, b))
    assert 0.1 < np.isfinite(found).mean() < 0.9
    assert (found > 0).mean() > 0.7
    for i, time in enumerate(found):
        one, two = pick(a, i), pick(b, i)
        until = min(time, 15.0)
        before = np.linspace(0, until, 1500)[:-1] if time else np.zeros(0)
        assert not meet(shapes_at(one, before), shapes_at(two, before)).any()
        if np.isfinite(time):
            after = np.array([time + 1e-7])
            assert meet(shapes_at(one, after), shapes_at(two, after)).all()


def test_overlapping_polygons_have_no_time_left(x64):
    a, b = pairs(2000, seed=1, within=0.0)
    touching = meet(outline(a), outline(b))
    assert 0.2 < touching.mean() < 0.8
    np.testing.assert_array_equal(np.asarray(collision(a, b)) == 0, touching)


def test_it_is_symmetric_and_invariant_under_motion_mirror_and_map_coordinates(x64):
    a, b = pairs(300, seed=2)
    reference = collision(a, b)
    rotation = np.array([[np.cos(1.1), -np.sin(1.1)], [np.sin(1.1), np.cos(1.1)]])

    def turned(o):
        return o.replace(position=o.position @ rotation.T + 5e5, heading=o.heading + 1.1)

    def mirrored(o):
        return o.replace(position=o.position * np.array([[1.0, -1.0]]), heading=-o.heading)

    def reversing(o):
        return o.replace(heading=o.heading + np.pi, speed=-o.speed)

    for one, other in ((b, a), *((f(a), f(b)) for f in (turned, mirrored, reversing))):
        np.testing.assert_allclose(collision(one, other), reference, rtol=1e-7)


def test_in_one_lane_it_is_the_one_dimensional_time(x64):
    rng = np.random.default_rng(3)
    gap, speed, front = rng.uniform(1, 60, 100), rng.uniform(0, 30, 100), rng.uniform(-10, 30, 100)
    heading = np.full(100, 0.7)
    way = np.array([np.cos(0.7), np.sin(0.7)])
    own = objects(np.zeros(2), heading, speed, length=5.0)
    leader = objects((gap + 4.5)[:, None] * way, heading, front, length=4.0, width=2.5)
    expected = time_to_collision(jnp.asarray(gap), jnp.asarray(speed), front_speed=jnp.asarray(front))
    np.testing.assert_allclose(collision(own, leader), expected, rtol=1e-9)


def test_broadcasting_and_vmap_equal_the_loop():
    rng = np.random.default_rng(4)
    a, b = random_objects(rng, (3,)), random_objects(rng, (5,))
    table = collision(jax.tree.map(lambda x: x[:, None], a), jax.tree.map(lambda x: x[None], b))
    batched = jax.vmap(lambda one: jax.vmap(lambda two: collision(one, two))(b))(a)
    loop = [[collision(pick(a, i), pick(b, j)) for j in range(5)] for i in range(3)]
    np.testing.assert_allclose(table, loop, rtol=1e-5)
    np.testing.assert_allclose(batched, loop, rtol=1e-5)


def test_an_absent_box_is_never_met_whatever_its_entries():
    a, b = pairs(4, seed=5)
    nothing = jax.tree.map(lambda x: jnp.full_like(x, jnp.nan) if x.dtype != bool else jnp.zeros_like(x), b)

    def total(own):
        found = box_time_to_collision(own, nothing)
        return jnp.sum(jnp.where(jnp.isinf(found), 0, found)), found

    slope, found = jax.jit(jax.grad(lambda p: total(a.replace(position=p)), has_aux=True))(a.position)
    assert np.isposinf(found).all()
    np.testing.assert_array_equal(slope, 0)


def test_single_precision_agrees_with_double():
    a, b = pairs(400, seed=6)
    single = np.asarray(collision(a, b))
    with jax.enable_x64(True):
        a, b = (jax.tree.map(lambda x: x if x.dtype == bool else jnp.asarray(np.asarray(x), float), o) for o in (a, b))
        double = np.asarray(collision(a, b))
    np.testing.assert_array_equal(np.isinf(single), np.isinf(double))
    np.testing.assert_allclose(single, double, rtol=1e-4)


@pytest.mark.parametrize("name", ["position", "heading", "speed", "length", "width"])
def test_gradients_equal_central_differences(x64, name):
    a, b = pairs(200, seed=7)
    direction = np.random.default_rng(8).normal(size=np.shape(getattr(a, name)))

    def moved(step):
        return collision(a.replace(**{name: getattr(a, name) + step * direction}), b)

    _, slope = jax.jvp(moved, (0.0,), (1.0,))
    step = 1e-6
    up, down = np.asarray(moved(step)), np.asarray(moved(-step))
    same = np.isfinite(up) & np.isfinite(down)
    assert same.sum() > 20
    np.testing.assert_allclose(slope[same], (up[same] - down[same]) / (2 * step), rtol=1e-4, atol=1e-6)
    np.testing.assert_array_equal(np.asarray(slope)[np.isinf(up) & np.isinf(down)], 0)


def test_gradients_are_finite_for_coincident_parallel_standing_touching_and_empty_boxes():
    position = np.array([[0, 0], [4, 0], [0, 2], [9, 0], [9, 3], [9, 0]], float)
    a = objects(np.zeros(2), np.zeros(6), [5.0, 5, 5, 5, 5, 0], length=[4.0, 4, 4, 4, 4, 0], width=[2.0, 2, 2, 2, 2, 0])
    b = objects(position, np.zeros(6), [5.0, 5, 0, 0, 5, 0])

    def total(position, heading, speed, length, width):
        found = box_time_to_collision(
            a.replace(position=position), b.replace(heading=heading, speed=speed, length=length, width=width)
        )
        return jnp.sum(jnp.where(jnp.isinf(found), 0, found))

    for slope in jax.jit(jax.grad(total, range(5)))(a.position, b.heading, b.speed, b.length, b.width):
        assert np.isfinite(slope).all()
