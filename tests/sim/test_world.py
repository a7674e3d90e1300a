import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.numerics.soft import Relaxation
from urbanjax.sim import world as worlds
from urbanjax.types import Command, SignalState, as_arrays
from urbanjax.vehicle.model import bicycle_step

NEAR = {"lane": 1, "speed": 8.0}


def test_ego_moves_as_the_bicycle_in_substeps(road):
    world = road.world(road.traffic(), ego_x=20.0, ego_speed=8.0)
    after = road.roll(world, 1, acceleration=1.0, steering=0.05)[-1]
    command = Command(jnp.asarray(1.0), jnp.asarray(0.05))
    expected = world.ego
    for _ in range(2):
        expected = bicycle_step(expected, command, params=road.params.vehicle, dt=0.05)
    for a, b in zip(jax.tree.leaves(after.ego), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6)
    np.testing.assert_allclose(after.time, 0.1, rtol=1e-6)


def test_nearest_objects_are_observed_nearest_first(road):
    params = road.params.replace(n_objects=3)
    vehicles = [NEAR | {"x": x} for x in (180.0, 130.0, 105.0, 60.0, 260.0)]
    world = road.world(road.traffic(*vehicles), ego_x=100.0, ego_speed=9.0)
    seen = worlds.observe(params, road.lanes, world=world).objects
    np.testing.assert_allclose(seen.position[:, 0], [105.0, 130.0, 60.0], atol=1e-3)
    np.testing.assert_allclose(seen.speed, 8.0)
    assert bool(seen.valid.all())


def test_objects_out_of_range_or_absent_are_invalid_and_padded(road):
    world = road.world(road.traffic(NEAR | {"x": 150.0}, NEAR | {"x": 400.0}), ego_x=100.0)
    seen = worlds.observe(road.params, road.lanes, world=world).objects
    assert seen.position.shape == (16, 2)
    assert np.asarray(seen.valid).tolist() == [True] + [False] * 15
    assert np.all(np.isfinite(np.asarray(seen.position)))


def test_observation_reports_pose_odometry_and_signals(road):
    world = road.world(road.traffic(), ego_x=30.0, ego_y=1.0, ego_speed=6.0, heading=0.2)
    one = jnp.ones(1)
    world = world.replace(
        ego=world.ego.replace(steering=jnp.asarray(0.1)),
        signals=worlds.SignalProgram(60 * one, 0 * one, 0.5 * one, one),
    )
    seen = worlds.observe(road.params, road.lanes, world=world)
    np.testing.assert_allclose(seen.pose.translation(), [30.0, 1.0], rtol=1e-6)
    np.testing.assert_allclose(seen.odometry.yaw_rate, 6.0 * np.tan(0.1) / 2.8, rtol=1e-5)
    assert int(seen.signals.state[0]) == SignalState.GREEN


def test_step_is_differentiable_in_the_ego(road):
    """A vehicle behind the ego reacts to what it does; the gradient through two steps is that of differences."""
    with jax.enable_x64(True):
        lanes = as_arrays(road.lanes, jnp.float64)
        params = as_arrays(road.params, jnp.float64).replace(lane_changes=False)
        soft = Relaxation(0.1, "soft")
        behind = [{"x": 85.0, "lane": 1, "speed": 11.0}, {"x": 70.0, "lane": 0, "speed": 11.0}]
        start = road.world(road.traffic(*behind, n=2, dtype=jnp.float64), ego_x=100.0, ego_y=1.2, ego_speed=8.0)

        @jax.jit
        @jax.value_and_grad
        def value(x):
            ego = start.ego.replace(position=start.ego.position + x[:2], speed=start.ego.speed + x[2])
            world = start.replace(ego=ego)
            command = Command(x[3], x[4])

            def advance(world, _):
                return worlds.step(params, lanes, world, command, jnp.asarray(0.1), soft), None

            world, _ = jax.lax.scan(advance, world, None, length=3)
            seen = worlds.observe(params, lanes, world=world)
            return jnp.sum(seen.objects.position[:, 0]) + jnp.sum(world.traffic.speed) + world.ego.position[1]

        origin = jnp.asarray([0.0, 0.0, 0.0, 0.1, 0.01])
        gradient = value(origin)[1]
        size = 1e-6
        differences = [(value(origin + size * e)[0] - value(origin - size * e)[0]) / (2 * size) for e in np.eye(5)]
        np.testing.assert_allclose(gradient, differences, rtol=1e-5, atol=1e-8)
        assert np.all(np.abs(gradient) > 1e-6)
