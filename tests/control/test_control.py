"""Controllers: known answers and limits."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.control.longitudinal import LongitudinalParams, accelerate
from urbanjax.control.pure_pursuit import PurePursuitParams, look_ahead, steer
from urbanjax.numerics.soft import Relaxation
from urbanjax.types import Command, Path, VehicleState
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.model import bicycle_step
from urbanjax.vehicle.params import VehicleParams

VEHICLE = VehicleParams()
PURSUIT = Driving(VEHICLE, PurePursuitParams(), Relaxation(), 0.1)
TRACKING = PURSUIT.of(LongitudinalParams())


def state(x=0.0, y=0.0, heading=0.0, speed=8.0):
    zero = jnp.zeros(())
    return VehicleState(jnp.array([x, y]), jnp.asarray(heading), jnp.asarray(speed), zero, zero)


def path(points, heading=0.0):
    points = jnp.asarray(points)
    zero = jnp.zeros(points.shape[0])
    station = jnp.arange(points.shape[0]) * 1.0
    return Path(station=station, offset=zero, position=points, heading=zero + heading, curvature=zero)


def circle(radius, n=60):
    angle = jnp.linspace(0, 1.2, n) * np.sign(radius)
    return path(radius * jnp.stack([jnp.sin(angle), 1 - jnp.cos(angle)], axis=1), angle)


@pytest.mark.parametrize("n", [60, 6])
@pytest.mark.parametrize("radius", [15.0, 40.0, -25.0])
def test_arc_gives_the_arc_s_steering(radius, n):
    """Even where a few points are all that is known of it: a chord would ask for more."""
    expected = np.arctan(VEHICLE.wheelbase / radius)
    assert float(steer(circle(radius, n), PURSUIT, state=state())) == pytest.approx(expected, rel=2e-2)


def test_straight_path_keeps_the_wheel_straight_and_offset_turns_towards_it():
    straight = path(np.stack([np.arange(60.0), np.zeros(60)], axis=1))
    assert float(steer(straight, PURSUIT, state=state())) == pytest.approx(0, abs=1e-6)
    assert float(steer(straight, PURSUIT, state=state(y=1.0))) < 0


def test_converges_onto_a_line():
    line = path(np.stack([np.arange(120.0), np.zeros(120)], axis=1))

    def body(s, _):
        ahead = line.replace(position=line.position + jnp.stack([s.position[0], jnp.zeros(())])[None, :])
        command = Command(jnp.zeros(()), steer(ahead, PURSUIT, state=s))
        return bicycle_step(s, command, params=VEHICLE, dt=0.1), s.position[1]

    _, lateral = jax.lax.scan(body, state(y=2.0), length=80)
    assert abs(float(lateral[-1])) < 0.02
    assert float(lateral.min()) > -0.4


def test_look_ahead_is_measured_along_the_path():
    straight = path(np.stack([3.0 * np.arange(4), np.zeros(4)], axis=1))
    np.testing.assert_allclose(look_ahead(straight, jnp.asarray(5.0)), [5.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(look_ahead(straight, jnp.asarray(11.0)), [11.0, 0.0], atol=1e-6)
    on_circle = look_ahead(circle(10.0, 7), jnp.asarray(5.0))
    np.testing.assert_allclose(jnp.linalg.norm(on_circle - jnp.asarray([0.0, 10.0])), 10.0, atol=1e-3)


def wanted(reference, previous=0.0, emergency=0.0, **params):
    driving = TRACKING.of(LongitudinalParams(**params))
    given = {"previous": previous, "reference": reference, "emergency": emergency}
    return float(accelerate(jnp.asarray(8.0), driving, **{k: jnp.asarray(v) for k, v in given.items()}))


@pytest.mark.parametrize(("reference", "expected"), [(8.3, 0.5), (30.0, 2.0), (0.0, -4.0)])
def test_speed_tracking_is_proportional_and_limited(reference, expected):
    assert wanted(reference, easy_jerk=1e3, onset_jerk=1e3) == pytest.approx(expected, rel=1e-5)
    assert wanted(reference, previous=expected) == pytest.approx(expected, rel=1e-5)


def test_acceleration_changes_no_faster_than_the_greatest_jerk():
    assert wanted(30.0, previous=-4.0) == pytest.approx(-3.2)  # far too much braking: fast
    assert wanted(7.0, previous=-3.0) == pytest.approx(-2.6)  # a little too much: easily
    assert wanted(30.0, previous=-0.1) == pytest.approx(0.15)  # gently, once it no longer brakes
    assert wanted(30.0, previous=1.0) == pytest.approx(1.15)
    assert wanted(6.0, previous=1.0) == pytest.approx(0.6)  # comfortable braking: easily
    assert wanted(2.0, previous=1.0) == pytest.approx(0.2)  # more than that: fast
    assert wanted(0.0, previous=2.0, max_jerk=4.0) == pytest.approx(1.6)


def test_emergency_brakes_fully():
    assert wanted(20.0, previous=2.0, emergency=1.0) == pytest.approx(-VEHICLE.max_deceleration)


def test_finite_gradient_on_a_degenerate_path():
    still = path(np.zeros((10, 2)))
    gradient = jax.grad(lambda x: steer(still, PURSUIT, state=state(x=x)))(0.0)
    assert np.isfinite(gradient)
