import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.traffic.safety.following import required_deceleration, time_gap, time_headway, time_to_collision


def sample(n=200, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(1, 60, n), rng.uniform(0, 30, n), rng.uniform(-10, 30, n)


def arrays(*values):
    return [jnp.asarray(v, jnp.zeros(()).dtype) for v in values]


def test_the_gap_is_closed_after_the_time_to_collision_and_not_before(x64):
    gap, speed, front = arrays(*sample())
    found = np.asarray(time_to_collision(gap, speed, front_speed=front))
    never = np.isinf(found)
    assert 0.2 < never.mean() < 0.8
    time = np.where(never, 1e4, found)
    at = gap + (front - speed) * time
    np.testing.assert_allclose(at[~never], 0, atol=1e-9)
    assert (at[never] >= gap[never]).all()


def test_the_required_deceleration_stops_the_closing_at_the_bumper(x64):
    gap, speed, front = arrays(*sample(seed=1))
    found = np.asarray(required_deceleration(gap, speed, front_speed=front))
    closing = speed > front
    time = ((speed - front) / np.where(closing, found, 1))[closing]
    left = gap[closing] + (front - speed)[closing] * time + found[closing] * time**2 / 2
    np.testing.assert_allclose(left, 0, atol=1e-9)
    np.testing.assert_array_equal(found[~closing], 0)


def test_the_headway_is_the_time_until_the_follower_is_where_the_leader_is(x64):
    gap, speed, _ = arrays(*sample(seed=2))
    length = jnp.full_like(gap, 4.5)
    headway, behind = time_headway(gap, speed, front_length=length), time_gap(gap, speed)
    np.testing.assert_allclose(headway * speed, gap + length, rtol=1e-12)
    np.testing.assert_allclose(behind * speed, gap, rtol=1e-12)


@pytest.mark.parametrize(
    ("gap", "speed", "front", "ttc", "behind", "headway", "deceleration"),
    [
        (20.0, 15.0, 10.0, 4.0, 4 / 3, 1.6, 0.625),
        (20.0, 10.0, 10.0, np.inf, 2.0, 2.4, 0.0),
        (20.0, 0.0, 0.0, np.inf, np.inf, np.inf, 0.0),
        (20.0, 0.0, -5.0, 4.0, np.inf, np.inf, 0.625),  # oncoming, standing
        (20.0, -5.0, -10.0, 4.0, np.inf, np.inf, 0.625),  # reverses from an oncoming one
        (0.0, 10.0, 5.0, 0.0, 0.0, 0.4, np.inf),  # touching
        (-1.0, 5.0, 10.0, 0.0, 0.0, 0.6, np.inf),  # overlapping
        (-9.0, 5.0, 10.0, 0.0, 0.0, 0.0, np.inf),
        (0.0, 0.0, 0.0, 0.0, 0.0, np.inf, np.inf),
    ],
)
def test_known_answers(gap, speed, front, ttc, behind, headway, deceleration):
    gap, speed, front, length = arrays(gap, speed, front, 4.0)
    np.testing.assert_allclose(time_to_collision(gap, speed, front_speed=front), ttc, rtol=1e-6)
    np.testing.assert_allclose(time_gap(gap, speed), behind, rtol=1e-6)
    np.testing.assert_allclose(time_headway(gap, speed, front_length=length), headway, rtol=1e-6)
    np.testing.assert_allclose(required_deceleration(gap, speed, front_speed=front), deceleration, rtol=1e-6)


FUNCTIONS = {
    "time_to_collision": lambda gap, speed, front: time_to_collision(gap, speed, front_speed=front),
    "required_deceleration": lambda gap, speed, front: required_deceleration(gap, speed, front_speed=front),
    "time_headway": lambda gap, speed, front: time_headway(gap, speed, front_length=front),
}


@pytest.mark.parametrize("function", FUNCTIONS.values(), ids=FUNCTIONS)
@pytest.mark.parametrize("which", range(3))
def test_gradients_equal_central_differences(x64, function, which):
    gap, speed, front = sample(100, seed=3)
    keep = (np.abs(speed - front) > 0.1) & (speed > 0.1)
    given = arrays(*(x[keep] for x in (gap, speed, front)))
    _, slope = jax.jvp(lambda x: function(*given[:which], x, *given[which + 1 :]), (given[which],), (given[0] * 0 + 1,))
    step = 1e-6
    up, down = (function(*given[:which], given[which] + s, *given[which + 1 :]) for s in (step, -step))
    finite = np.isfinite(np.asarray(up))
    assert finite.mean() > 0.3
    expected = (np.asarray(up)[finite] - np.asarray(down)[finite]) / (2 * step)
    np.testing.assert_allclose(slope[finite], expected, rtol=1e-5, atol=1e-7)
    np.testing.assert_array_equal(slope[~finite], 0)


@pytest.mark.parametrize("function", FUNCTIONS.values(), ids=FUNCTIONS)
def test_gradients_are_finite_in_contact_at_rest_and_at_equal_speeds(function):
    cases = np.array([[0, 5, 5], [0, 0, 0], [-1, 5, 0], [1e-6, 40, 0], [2e-6, 40, 0], [1e6, 1e-6, 0], [9, 3, 3]])
    for slope in jax.grad(lambda *a: jnp.sum(function(*a)), (0, 1, 2))(*arrays(*cases.T)):
        assert np.isfinite(slope).all()
