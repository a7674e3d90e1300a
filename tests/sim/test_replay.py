import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.sim import replay, signals
from urbanjax.sim import world as worlds
from urbanjax.sim.replay import Replay
from urbanjax.types import Command, SignalState, as_arrays


def recorded(valid=((1, 1), (1, 1), (1, 0), (0, 0))) -> Replay:
    """Two road users at four times: one drives along x and turns through the angle pi, one stands."""
    steps = np.arange(4.0)
    position = np.stack([np.stack([5 * steps, 0 * steps], 1), np.full((4, 2), 7.0)], 1)
    heading = np.stack([np.array([3.0, 3.1, -3.1, -3.0]), 0 * steps], 1)
    speed = np.stack([10 + steps, 0 * steps], 1)
    sizes = {"length": np.array([4.0, 5.0]), "width": np.array([1.8, 2.0])}
    return as_arrays(Replay(position, heading, speed, valid=np.array(valid, bool), period=0.5, **sizes))


@pytest.fixture(scope="module")
def at():
    jitted = jax.jit(replay.objects)
    return lambda rows, time: jitted(rows, jnp.asarray(time))


def test_records_are_met_and_what_lies_between_is_linear(at):
    now, then = at(recorded(), 0.5), at(recorded(), 0.75)
    np.testing.assert_allclose(now.position, [[5, 0], [7, 7]])
    np.testing.assert_allclose(now.heading, [3.1, 0], rtol=1e-6)
    np.testing.assert_allclose(then.position[0], [7.5, 0])
    np.testing.assert_allclose(np.cos(then.heading[0]), -1, atol=1e-6)
    np.testing.assert_allclose(then.speed, [11.5, 0])


def test_nobody_outlives_the_record(at):
    rows = recorded()
    assert [at(rows, t).valid.tolist() for t in (0.0, 0.9, 1.0, 1.5, 5.0)] == [
        [True, True],
        [True, True],
        [True, False],
        [False, False],
        [False, False],
    ]
    np.testing.assert_allclose(at(rows, 0.9).position[1], [7, 7])
    assert not bool(at(recorded(np.ones((4, 2))), 3.0).valid.any())


def test_the_ego_sees_recorded_traffic_and_simulated_traffic(road):
    world = road.world(road.traffic({"x": 520.0, "lane": 0, "speed": 10.0}), ego_x=500.0)
    seen = recorded(np.ones((4, 2)))
    shifted = seen.replace(position=seen.position + jnp.asarray([[[510.0, 0.0]]]))
    both = worlds.observe(road.params, road.lanes, world=world.replace(replay=shifted)).objects
    alone = worlds.observe(road.params, road.lanes, world=world).objects
    assert int(alone.valid.sum()) == 1
    assert int(both.valid.sum()) == 3
    np.testing.assert_allclose(both.position[0], [510, 0], atol=1e-4)
    after = road.step(road.params, road.lanes, world.replace(replay=shifted), as_arrays(Command(0.0, 0.0)), 0.5)
    moved = worlds.everybody(road.params, road.lanes, world=after)
    np.testing.assert_allclose(moved.position[-2], [515, 0], atol=1e-4)


def test_a_signal_that_is_always_green_is_green():
    shown = signals.show(signals.always_green(3), jnp.asarray(12.34))
    assert shown.state.tolist() == [SignalState.GREEN] * 3
