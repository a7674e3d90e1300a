"""Scripted vehicles do what their numbers say, to the moment, and nobody else is touched."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.sim.conftest import x_of
from urbanjax.sim.scripts import Script
from urbanjax.types import Command

SPEED, LANE = 10.0, 3.5


def script_of(traffic, **numbers):
    rows = {"brakes_at": 1e3, "braking": 0.0, "moves_at": 1e3, "moves_for": 1.0} | numbers
    first = jnp.arange(traffic.speed.shape[0]) == 0
    return Script(first, **{name: jnp.full_like(traffic.speed, value) for name, value in rows.items()})


def world_of(road, *, script=None, **fields):
    one = {"x": 100.0, "lane": 1, "speed": SPEED, "reacts": False, "desired_speed": SPEED * 3.6 / 50} | fields
    two = {"x": 40.0, "lane": 0, "speed": SPEED, "desired_speed": SPEED * 3.6 / 50}
    traffic = road.traffic(one, two)
    world = road.world(traffic)
    return world if script is None else world.replace(script=script_of(traffic, **script))


def test_a_script_that_does_nothing_yet_changes_no_bit(road):
    plain, scripted = (road.roll(world_of(road, script=script), 10)[-1].traffic for script in (None, {}))
    jax.tree.map(np.testing.assert_array_equal, plain, scripted)


@pytest.mark.parametrize("brakes_at", [0.32, 0.5, 1.0])
def test_braking_begins_to_the_moment_and_ends_at_a_stand(road, brakes_at):
    states = road.roll(world_of(road, script={"brakes_at": brakes_at, "braking": 5.0}), 40)
    after = states[20].traffic
    assert after.speed[0] == pytest.approx(SPEED - 5.0 * (2.0 - brakes_at), abs=1e-4)
    assert states[-1].traffic.speed[0] == 0
    stopped = SPEED * brakes_at + SPEED**2 / 10
    assert x_of(states[-1].traffic)[0] - 100.0 == pytest.approx(stopped, abs=0.02)  # of a substep
    assert after.speed[1] == pytest.approx(SPEED, abs=1e-3)


def test_a_move_lasts_as_long_as_stated(road):
    beside = {"offset": LANE, "offset_from": LANE, "moved": 0.0}
    states = road.roll(world_of(road, script={"moves_at": 0.73, "moves_for": 2.0}, **beside), 30)
    offsets = np.array([state.traffic.offset[0] for state in states])
    np.testing.assert_allclose(offsets[:8], LANE)
    assert offsets[17] == pytest.approx(LANE * 0.5, abs=0.15)  # halfway at 1.73 s
    assert offsets[27] > 0
    assert offsets[28] == pytest.approx(0, abs=1e-6)


def test_where_it_stops_has_the_slope_of_when_it_brakes(road):
    world = world_of(road)

    def stopped(brakes_at):
        now = world.replace(script=script_of(world.traffic, brakes_at=brakes_at, braking=5.0))
        step = jax.checkpoint(lambda state, _: (road.step(road.params, road.lanes, state, *still), None))
        return jax.lax.scan(step, now, None, length=40)[0].traffic.station[0]

    still = Command(jnp.zeros(()), jnp.zeros(())), jnp.asarray(0.1)
    assert jax.grad(stopped)(0.52) == pytest.approx(SPEED, rel=1e-3)  # each second later is ten metres further
