"""Comfort as nuPlan tells it: rides on either side of each bound."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.types import VehicleState
from urbanjax.vehicle.comfort import ComfortParams, comfortable
from urbanjax.vehicle.params import VehicleParams

COUNT, DT = 41, 0.1


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
