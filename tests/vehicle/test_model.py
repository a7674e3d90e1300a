import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.types import Command, VehicleState
from urbanjax.vehicle.model import bicycle_step, box_centre, highway_step
from urbanjax.vehicle.params import VehicleParams


def make(x=0.0, y=0.0, heading=0.0, speed=0.0, steering=0.0):
    return VehicleState(
        jnp.asarray([x, y]), jnp.asarray(heading), jnp.asarray(speed), jnp.asarray(0.0), jnp.asarray(steering)
    )


def command(acceleration, steering):
    return Command(jnp.asarray(acceleration), jnp.asarray(steering))


def test_equals_highway_env():
    kinematics = pytest.importorskip("highway_env.vehicle.kinematics")
    rng = np.random.default_rng(0)
    with jax.enable_x64(True):
        for _ in range(200):
            position, heading = rng.normal(0, 100, 2), rng.uniform(-4, 4)
            speed, acceleration = rng.uniform(-45, 45), rng.uniform(-6, 6)
            steering, dt = rng.uniform(-1, 1), rng.uniform(0.01, 0.2)
            vehicle = kinematics.Vehicle(None, position.copy(), heading, speed)
            vehicle.act({"acceleration": acceleration, "steering": steering})
            vehicle.step(dt)
            zero = jnp.asarray(0.0)
            state = VehicleState(jnp.asarray(position), jnp.asarray(heading), jnp.asarray(speed), zero, zero)
            after = highway_step(state, command(acceleration, steering), dt=dt)
            np.testing.assert_allclose(after.position, vehicle.position, atol=1e-6)
            np.testing.assert_allclose(after.heading, vehicle.heading, atol=1e-6)
            np.testing.assert_allclose(after.speed, vehicle.speed, atol=1e-6)


def test_drives_a_circle_exactly():
    with jax.enable_x64(True):
        params = VehicleParams()
        state = make(speed=8.0, steering=0.3)
        radius = params.wheelbase / np.tan(0.3)
        step = jax.jit(lambda s: bicycle_step(s, command(0.0, 0.3), params=params, dt=0.1))
        for _ in range(50):
            state = step(state)
        angle = 8.0 * 5.0 / radius
        np.testing.assert_allclose(state.position, [radius * np.sin(angle), radius * (1 - np.cos(angle))], atol=1e-9)
        np.testing.assert_allclose(state.heading, angle, atol=1e-9)


def test_constant_acceleration_covers_the_textbook_distance():
    with jax.enable_x64(True):
        state = make(speed=3.0)
        for _ in range(10):
            state = bicycle_step(state, command(1.5, 0.0), params=VehicleParams(), dt=0.1)
        np.testing.assert_allclose(state.position, [3.0 + 0.75, 0.0], atol=1e-12)
        np.testing.assert_allclose(state.speed, 4.5, atol=1e-12)


def test_limits_take_effect():
    params = VehicleParams()
    state = bicycle_step(make(speed=10.0), command(99.0, 99.0), params=params, dt=0.1)
    assert np.isclose(state.acceleration, params.max_acceleration, rtol=1e-4)
    assert np.isclose(state.steering, params.max_steering_rate * 0.1)
    held = bicycle_step(make(speed=10.0, steering=params.max_steering), command(-99.0, 99.0), params=params, dt=0.1)
    assert np.isclose(held.steering, params.max_steering)
    assert np.isclose(held.acceleration, -params.max_deceleration, rtol=1e-4)


def test_never_reverses():
    state = bicycle_step(make(speed=0.2), command(-5.0, 0.0), params=VehicleParams(), dt=0.1)
    assert state.speed == 0
    assert np.isclose(state.acceleration, -2.0)
    again = bicycle_step(state, command(-5.0, 0.0), params=VehicleParams(), dt=0.1)
    np.testing.assert_array_equal(again.position, state.position)
    assert again.acceleration == 0


@pytest.mark.parametrize("steering", [0.0, 1e-12, -1e-5, 0.2, 0.55])
@pytest.mark.parametrize("speed", [0.0, 5.0])
def test_gradient_matches_differences(steering, speed):
    with jax.enable_x64(True):

        def distance(x):
            state = make(speed=speed, steering=steering).replace(heading=x[2], speed=speed + x[3])
            state = bicycle_step(state, command(x[0] + 0.5, steering + x[1]), params=VehicleParams(), dt=0.1)
            return jnp.sum(state.position * jnp.asarray([1.0, 0.5])) + state.heading + state.speed

        gradient = jax.grad(distance)(jnp.zeros(4))
        size = 1e-6
        differences = [(distance(size * e) - distance(-size * e)) / (2 * size) for e in jnp.eye(4)]
        np.testing.assert_allclose(gradient, differences, atol=1e-7)


def test_box_centre_is_ahead_of_the_axle():
    params = VehicleParams()
    centre = box_centre(make(1.0, 2.0, np.pi / 2), params)
    np.testing.assert_allclose(centre, [1.0, 2.0 + params.length / 2 - params.rear_overhang], atol=1e-6)
