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
