"""Comfort as nuPlan tells it: smoothing against SciPy's filter, and rides on either side of each bound."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import savgol_filter

from urbanjax.types import VehicleState
from urbanjax.vehicle.comfort import ComfortParams, comfortable, smoothing
from urbanjax.vehicle.params import VehicleParams

COUNT, DT = 41, 0.1


@pytest.mark.parametrize(("window", "order", "derivative"), [(0, 2, 0), (0, 2, 1), (5, 2, 1), (5, 3, 2), (9, 2, 0)])
def test_smoothing_is_that_of_savitzky_and_golay(window, order, derivative):
    values = np.random.default_rng(0).normal(size=COUNT)
    expected = savgol_filter(values, window or COUNT, order, deriv=derivative)
    np.testing.assert_allclose(smoothing(COUNT, window, order=order, derivative=derivative) @ values, expected)


def test_smoothing_keeps_polynomials_and_few_values():
    x = np.arange(6.0)
    np.testing.assert_allclose(smoothing(6, 4, order=2, derivative=1) @ x**2, 2 * x, atol=1e-9)
    np.testing.assert_allclose(smoothing(2, 5, order=2, derivative=1) @ np.array([1.0, 3.0]), [2, 2])
    np.testing.assert_array_equal(smoothing(1, 5, order=2, derivative=1), [[0]])


@pytest.fixture(scope="module")
def judge():
    params, vehicle = ComfortParams(), VehicleParams()
    run = jax.jit(lambda ride: comfortable(ride, vehicle, period=DT, params=params))

    def calm(speed=10.0, acceleration=0.0, yaw_rate=0.0, jerk=0.0, yaw_acceleration=0.0):
        time = DT * np.arange(COUNT)
        turn = yaw_rate + yaw_acceleration * (time - time.mean())
        given = (
            np.stack([speed * time, 0 * time], -1), yaw_rate * time + yaw_acceleration * (time - time.mean()) ** 2 / 2,
            speed + 0 * time, acceleration + jerk * (time - time.mean()), np.arctan(turn * 2.8 / speed),
        )  # fmt: skip
        return bool(run(VehicleState(*(jnp.asarray(x, jnp.float32) for x in given))))

    return calm


@pytest.mark.parametrize(
    ("inside", "outside"),
    [
        ({"acceleration": 2.3}, {"acceleration": 2.5}),
        ({"acceleration": -4.0}, {"acceleration": -4.1}),
        ({"yaw_rate": 0.47}, {"yaw_rate": 0.5}),  # lateral acceleration at 10 m/s
        ({"yaw_rate": 0.9, "speed": 2.0}, {"yaw_rate": 1.0, "speed": 2.0}),
        ({"yaw_acceleration": 0.4, "speed": 0.5}, {"yaw_acceleration": 2.0, "speed": 0.5}),
        ({"jerk": 1.0}, {"jerk": 4.2}),
    ],
)
def test_each_bound(judge, inside, outside):
    assert judge(**inside)
    assert not judge(**outside)
