"""Least safe distances against the worst case, stepped; margins against distances of corners."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.traffic.safety.scenes import objects, outline, random_objects
from urbanjax.traffic.safety.rss import (
    RSSParams,
    lateral_distance,
    opposite_direction_distance,
    rss,
    same_direction_distance,
)

jitted = jax.jit(rss)
margins = jax.jit(lambda a, b, params: jnp.sum(rss(a, b, params=params).margin))
by_params = jax.jit(jax.grad(lambda params, a, b: margins(a, b, params)))
PARAMS = RSSParams(response_time=0.7, lateral_margin=0.3)
STEP = 1e-3


def stepped(speed, acceleration, braking):
    """Way made [steps, n] in 30 s: accelerated during the response, then braked until standing."""
    way, ways = np.zeros_like(speed), []
    for k in range(30_000):
        if k * STEP < PARAMS.response_time - 1e-9:
            after = speed + acceleration * STEP
        else:
            after = np.sign(speed) * np.maximum(np.abs(speed) - braking * STEP, 0)
        way, speed = way + (speed + after) / 2 * STEP, after
        ways.append(way)
        if not speed.any():
            break
    return np.stack(ways + [way] * (30_000 - len(ways)))


def braked_at_once(speed, braking):
    """Way made [steps, n] in 30 s by one that brakes from the first moment."""
    time = np.minimum((np.arange(30_000)[:, None] + 1) * STEP, speed / braking)
    return speed * time - braking * time**2 / 2


def speeds(seed, low, high, n=60):
    return np.random.default_rng(seed).uniform(low, high, (2, n))


def test_the_same_direction_distance_is_what_the_worst_case_closes(x64):
    rear, front = speeds(0, 0, 30)
    worst = stepped(rear, PARAMS.max_acceleration, PARAMS.min_braking) - braked_at_once(front, PARAMS.max_braking)
    found = np.asarray(same_direction_distance(jnp.asarray(rear), jnp.asarray(front), params=PARAMS))
    assert (found == 0).any()
    np.testing.assert_allclose(found, np.maximum(worst.max(0), 0), atol=0.02)


def test_the_opposite_direction_distance_is_what_the_worst_case_closes(x64):
    one, two = speeds(1, 0, 30)
    worst = stepped(one, PARAMS.max_acceleration, PARAMS.min_braking_correct)
    worst = worst + stepped(two, PARAMS.max_acceleration, PARAMS.min_braking)
    found = opposite_direction_distance(jnp.asarray(one), jnp.asarray(two), params=PARAMS)
    np.testing.assert_allclose(found, worst.max(0), atol=0.03)


def test_the_lateral_distance_is_what_the_worst_case_closes_and_the_margin(x64):
    one, two = speeds(2, -2, 2)
    given = PARAMS.max_lateral_acceleration, PARAMS.min_lateral_braking
    worst = stepped(one, *given) + stepped(two, *given)
    found = np.asarray(lateral_distance(jnp.asarray(one), jnp.asarray(two), params=PARAMS))
    assert 0.2 < (found > PARAMS.lateral_margin).mean() < 0.9
    np.testing.assert_allclose(found, PARAMS.lateral_margin + np.maximum(worst.max(0), 0), atol=5e-3)


def test_the_published_lemmas_hold_number_by_number(x64):
    """By hand, with the defaults: rho 1 s, a 3.5, b_max 8, b_min 4, correct 3; lateral 0.2 and 0.8."""
    ten, zero = jnp.asarray(10.0), jnp.asarray(0.0)
    params = RSSParams()
    assert same_direction_distance(ten, ten, params=params) == 10 + 1.75 + 13.5**2 / 8 - 100 / 16
    assert opposite_direction_distance(ten, ten, params=params) == 23.5 + 13.5**2 / 6 + 13.5**2 / 8
    np.testing.assert_allclose(lateral_distance(zero, zero, params=params), 2 * (0.1 + 0.04 / 1.6))


def pairs(seed, n=300):
    rng = np.random.default_rng(seed)
    a, b = random_objects(rng, (n,)), random_objects(rng, (n,))
    along = rng.random(n) < 0.5  # half of them nearly parallel or opposite
    heading = a.heading + np.where(rng.random(n) < 0.5, 0, np.pi) + rng.uniform(-0.1, 0.1, n)
    return a, b.replace(heading=jnp.where(along, heading, b.heading))


def gaps_of_corners(a, b):
    """Distances of b's corners from a's along and across a's heading, as intervals."""
    heading = np.asarray(a.heading)
    found = []
    for way in (np.stack([np.cos(heading), np.sin(heading)], -1), np.stack([-np.sin(heading), np.cos(heading)], -1)):
        one, two = (np.einsum("nkd,nd->nk", outline(o), way) for o in (a, b))
        found.append(np.maximum(two.min(1) - one.max(1), one.min(1) - two.max(1)))
    return found


def test_margins_are_the_distances_of_corners_less_the_least_safe_ones(x64):
    a, b = pairs(3)
    found = jitted(a, b, params=PARAMS)
    along, across = gaps_of_corners(a, b)
    turn = np.asarray(b.heading - a.heading)
    away = np.asarray(b.position - a.position)
    forward = np.stack([np.cos(a.heading), np.sin(a.heading)], -1)
    ahead, left = (away * forward).sum(-1), forward[:, 0] * away[:, 1] - forward[:, 1] * away[:, 0]
    own, other, sideways = np.asarray(a.speed), np.asarray(b.speed) * np.cos(turn), np.asarray(b.speed) * np.sin(turn)
    kinds = set()
    for i in range(len(turn)):
        one, two = (jnp.asarray(x) for x in (own[i], other[i]))
        if ahead[i] >= 0 and other[i] < -0.1:
            kind, least = "oncoming", opposite_direction_distance(one, -two, params=PARAMS)
        elif ahead[i] >= 0:
            kind, least = "ahead", same_direction_distance(one, jnp.maximum(two, 0), params=PARAMS)
        else:
            kind, least = "behind", same_direction_distance(jnp.maximum(two, 0), one, params=PARAMS)
        kinds.add(kind)
        beside = lateral_distance(
            jnp.asarray(0.0), jnp.asarray(-sideways[i] if left[i] > 0 else sideways[i]), params=PARAMS
        )
        np.testing.assert_allclose(found.longitudinal[i], along[i] - least, atol=1e-9)
        np.testing.assert_allclose(found.lateral[i], across[i] - beside, atol=1e-9)
    assert kinds == {"oncoming", "ahead", "behind"}
    unsafe = (np.asarray(found.longitudinal) < 0) & (np.asarray(found.lateral) < 0)
    assert 0.05 < unsafe.mean() < 0.95
    np.testing.assert_array_equal(found.dangerous, unsafe)
    np.testing.assert_array_equal(found.margin, np.maximum(found.longitudinal, found.lateral))


def test_margins_are_invariant_under_motion_and_mirror(x64):
    a, b = pairs(4)
    reference = jitted(a, b, params=PARAMS)
    rotation = np.array([[np.cos(0.9), -np.sin(0.9)], [np.sin(0.9), np.cos(0.9)]])
    for change in (
        lambda o: o.replace(position=o.position @ rotation.T + 1e4, heading=o.heading + 0.9),
        lambda o: o.replace(position=o.position * np.array([[1.0, -1.0]]), heading=-o.heading),
    ):
        found = jitted(change(a), change(b), params=PARAMS)
        np.testing.assert_allclose(found.margin, reference.margin, atol=1e-8)


def test_one_that_reverses_towards_a_vehicle_behind_meets_it(x64):
    own, other = (objects(p, 0.0, v) for p, v in ((np.zeros(2), -3.0), (np.array([-50.0, 0.0]), 5.0)))
    least = opposite_direction_distance(jnp.asarray(3.0), jnp.asarray(5.0), params=PARAMS)
    np.testing.assert_allclose(jitted(own, other, params=PARAMS).longitudinal, 46 - least)


def test_an_absent_vehicle_is_no_danger_and_passes_no_gradient():
    own = objects(np.zeros((2, 2)), [0.0, 0.0], 10.0)
    other = objects(np.full((2, 2), np.nan), [np.nan, np.nan], np.nan, valid=False)
    found = jitted(own, other, params=PARAMS)
    assert np.isposinf(found.margin).all()
    assert not np.asarray(found.dangerous).any()
    slope = jax.jit(jax.grad(lambda s: margins(own.replace(speed=s), other, PARAMS)))(own.speed)
    np.testing.assert_array_equal(slope, 0)


@pytest.mark.parametrize("name", ["position", "heading", "speed"])
def test_gradients_of_the_margin_equal_central_differences(x64, name):
    a, b = pairs(5)
    direction = np.random.default_rng(6).normal(size=np.shape(getattr(b, name)))

    def moved(step):
        return jitted(a, b.replace(**{name: getattr(b, name) + step * direction}), params=PARAMS).margin

    _, slope = jax.jvp(moved, (0.0,), (1.0,))
    np.testing.assert_allclose(slope, (moved(1e-6) - moved(-1e-6)) / 2e-6, rtol=1e-5, atol=1e-6)
    step = 1e-6
    up, down = (margins(a, b, PARAMS.replace(response_time=0.7 + s)) for s in (step, -step))
    slope = by_params(jax.tree.map(jnp.asarray, PARAMS), a, b).response_time
    np.testing.assert_allclose(slope, (up - down) / (2 * step), rtol=1e-6)


def test_gradients_are_finite_for_coincident_and_standing_vehicles():
    own, other = (objects(np.zeros((3, 2)), np.zeros(3), speed) for speed in ([0.0, 5.0, 5.0], [0.0, 5.0, -0.1]))
    slope_of = jax.grad(lambda p, h, s: margins(own, other.replace(position=p, heading=h, speed=s), PARAMS), (0, 1, 2))
    slopes = jax.jit(slope_of)(other.position, other.heading, other.speed)
    assert all(np.isfinite(slope).all() for slope in slopes)
