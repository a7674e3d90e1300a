"""What the ego is told that has to find its pose: a scan, what its wheels say, and others as they are seen from it."""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int

from urbanjax.sim.lidar import LidarParams, sweep
from urbanjax.sim.scenery.scenery import Scenery
from urbanjax.types import Objects, Observation, Odometry, VehicleState, pytree


@pytree
class WheelErrors:
    """Of the speed of the wheels and of the yaw rate."""

    scale: float = 1.005  # of the speed that the wheels report
    noise: float = 0.05  # m/s
    yaw_bias: float = 0.001  # rad/s
    yaw_noise: float = 0.003  # rad/s

    def on(self, speed: Array, yaw_rate: Array, *, keys: Array) -> tuple[Array, Array]:
        """Both as they are reported. Args: speed [N] m/s; yaw_rate [N] rad/s; keys [2], of the noise of each."""
        rolled = speed * self.scale + self.noise * jax.random.normal(keys[0], speed.shape, speed.dtype)
        turned = yaw_rate + self.yaw_bias + self.yaw_noise * jax.random.normal(keys[1], speed.shape, speed.dtype)
        return jnp.maximum(rolled, 0.0), turned


@pytree
class Sensing:
    """What a sensor needs of the world beyond the road, for egos that find their pose from scans."""

    surroundings: Scenery
    key: Array  # of the noise
    wheels: WheelErrors | None = None  # None: odometry is exact
    silent: Array | None = None  # [2] s, of the world's time from when to when no scan arrives
    told: Array | None = None  # [3] x, y (m), heading (rad): where the ego is told that it begins; None: where it does


def sensed(
    params: LidarParams,
    sensing: Sensing,
    *,
    given: Observation,
    ego: VehicleState,
    others: Objects,
    time: Float[Array, ""],
    count: Int[Array, ""],
) -> Observation:
    """The observation with a scan in the place of its pose, and its objects in the body frame.

    Args: sensing, what there is to see; given, with the true pose and odometry; ego, its true state; others, all road
    users that the LiDAR meets; time [] s, of the world; count [], of its steps.
    """
    key, wheel_key = jax.random.split(jax.random.fold_in(sensing.key, count))
    true = given.odometry
    scan = sweep(params, sensing.surroundings, vehicles=others, ego=ego, yaw_rate=true.yaw_rate, key=key)
    if sensing.silent is not None:
        silent = (time >= sensing.silent[0]) & (time < sensing.silent[1])
        scan = scan.replace(valid=scan.valid & ~silent)
    odometry = true
    if sensing.wheels is not None:
        keys = jax.random.split(wheel_key)
        speed, yaw_rate = sensing.wheels.on(true.speed, true.yaw_rate, keys=keys)
        odometry = Odometry(speed, true.acceleration, true.steering, yaw_rate)
    seen = given.objects.seen_from(ego.pose.inverse())
    return given.replace(odometry=odometry, objects=seen, pose=None, scan=scan)
