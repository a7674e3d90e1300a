"""Eq. 28-29: known answers, the 0/0 of plain lane following, and bounds."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.behavior import gvp
from urbanjax.behavior.gvp import GVPParams
from urbanjax.behavior.params import BehaviorParams
from urbanjax.behavior.situation import Body
from urbanjax.behavior.surroundings import Surroundings
from urbanjax.numerics.soft import Relaxation
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.params import VehicleParams


def speeds(terminal, centre, tau, v_target=12.0, v_ego=4.0):
    def pair(p):
        return tuple(jnp.asarray(float(x)) for x in p)

    return gvp.plan_speed(
        pair(terminal),
        pair(centre),
        v_target=jnp.asarray(v_target),
        v_ego=jnp.asarray(v_ego),
        params=GVPParams(tau=jnp.asarray(tau)),
    )


def test_known_answer_midway():
    """The path ends on the target lane; the vehicle is a quarter of the way over."""
    plan = speeds(terminal=(0.0, 3.5), centre=(2.625, 0.875), tau=0.75)
    assert float(plan.micro) == pytest.approx(12.0)
    assert float(plan.cog) == pytest.approx(0.25 * 12 + 0.75 * 4)
    assert float(plan.reference) == pytest.approx(0.75 * 12 + 0.25 * 6)


@pytest.mark.parametrize(("tau", "expected"), [(0.0, 4.0), (1.0, 12.0)])
def test_extremes_of_tau_at_the_start_of_a_lane_change(tau, expected):
    plan = speeds(terminal=(0.0, 3.5), centre=(3.5, 0.0), tau=tau)
    assert float(plan.reference) == pytest.approx(expected)


def test_lane_following_has_finite_value_and_gradient():
    def reference(d):
        return speeds((d, d), (d, d), 0.5, v_target=7.0, v_ego=7.0).reference

    def traced(d):
        return gvp.blend(d, d, v_target=jnp.asarray(7.0), v_ego=jnp.asarray(7.0))

    assert float(reference(0.0)) == pytest.approx(7.0)
    assert np.isfinite(jax.grad(traced)(jnp.asarray(0.0)))


def test_reference_lies_between_the_two_speeds():
    rng = np.random.default_rng(1)
    for _ in range(20):
        d = rng.uniform(0, 4, 4)
        plan = speeds(d[:2], d[2:], rng.uniform())
        assert 4.0 - 1e-5 <= float(plan.reference) <= 12.0 + 1e-5


@pytest.mark.parametrize("mode", ["hard", "soft"])
def test_without_any_object_the_cap_is_the_speed(mode):
    none = jnp.zeros(3)
    fields = dict.fromkeys(Surroundings.__dataclass_fields__, none)
    found = gvp.following_speed(
        Surroundings(**{**fields, "valid": none > 0}),
        Driving(VehicleParams(), BehaviorParams(), Relaxation(0.01, mode), 0.1),
        occupancy=none,
        body=Body(rear=jnp.asarray(-3.0), front=jnp.asarray(2.0), offset=none[0], speed=jnp.asarray(8.0)),
        lead=none,
        cap=jnp.asarray(13.9),
    )
    assert float(found) == pytest.approx(13.9, abs=0.05)


def behind(speed, station, other, *, mode="hard"):
    """v_T beside one vehicle of the target lane that leads at arrival, whatever it does now."""
    one = jnp.ones(1)
    around = Surroundings(
        **{**dict.fromkeys(Surroundings.__dataclass_fields__, 0 * one), "valid": one > 0, "half_length": 2.35 * one}
        | {"station": station * one, "speed": other * one}
    )
    return gvp.following_speed(
        around,
        Driving(VehicleParams(), BehaviorParams(), Relaxation(0.01, mode), 0.1),
        occupancy=one,
        body=Body(rear=jnp.asarray(-3.7), front=jnp.asarray(0.0), offset=jnp.zeros(()), speed=jnp.asarray(speed)),
        lead=5.0 * one,
        cap=jnp.asarray(60 / 3.6),
    )


@pytest.mark.parametrize("mode", ["hard", "soft"])
def test_a_vehicle_behind_never_lowers_the_speed(mode):
    """Also one that will be ahead by the time of the lane change: the ego's brakes would not help it."""
    assert float(behind(9.0, -16.35, 14.0, mode=mode)) == pytest.approx(60 / 3.6, abs=0.05)
    rng = np.random.default_rng(0)
    for speed, station, other in rng.uniform([0, -40, 0], [20, -2.6, 30], (20, 3)):
        assert float(behind(speed, station, other, mode=mode)) == pytest.approx(60 / 3.6, abs=0.05)
    assert float(behind(9.0, 12.0, 5.0, mode=mode)) < 9.0
