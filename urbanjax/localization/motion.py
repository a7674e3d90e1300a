"""Motion from wheel speed and yaw rate: arcs in the plane of the vehicle."""

import jax.numpy as jnp
import jaxlie
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import safe
from urbanjax.types import Odometry, Scan


def arc(speed: Float[Array, "*n"], yaw_rate: Float[Array, "*n"], *, time: Float[Array, "*n"]) -> Float[Array, "3 *n"]:
    """X (m), y (m) and heading (rad) of the body at `time` s, in its frame at time 0; exact for constant rates."""
    turn = yaw_rate * time
    chord = speed * time * safe.sinc(turn / 2)
    return jnp.stack([chord * jnp.cos(turn / 2), chord * jnp.sin(turn / 2), turn])


def travelled(odometry: Odometry, time: float | Float[Array, ""]) -> jaxlie.SE3:
    """The motion of the body during `time` s: T_before_after."""
    x, y, heading = arc(odometry.speed, odometry.yaw_rate, time=jnp.asarray(time, odometry.speed.dtype))
    turn = jaxlie.SO3.from_z_radians(heading)
    return jaxlie.SE3.from_rotation_and_translation(turn, jnp.stack([x, y, jnp.zeros_like(x)]))


def propagate(pose: jaxlie.SE3, odometry: Odometry, *, time: float | Float[Array, ""]) -> jaxlie.SE3:
    """The pose `time` s later: what the localizer puts out between two scans, at the rate of the wheel sensors."""
    return pose @ travelled(odometry, time)


def deskew(scan: Scan, mount: jaxlie.SE3, *, odometry: Odometry) -> Float[Array, "n 3"]:
    """The points [N, 3] (m) of a sweep in the body frame at its stamp, the motion during the sweep taken out.

    Args: mount, T_body_lidar; odometry, whose speed and yaw rate held during the sweep.
    """
    flat = scan.position.reshape(-1, 3)
    turn, shift = mount.rotation().as_matrix(), mount.translation()
    x, y, z = (
        sum((turn[i, k] * flat[:, k] for k in range(1, 3)), turn[i, 0] * flat[:, 0] + shift[i]) for i in range(3)
    )
    time = scan.time.reshape(-1)
    ahead, aside, heading = arc(
        jnp.broadcast_to(odometry.speed, time.shape), jnp.broadcast_to(odometry.yaw_rate, time.shape), time=time
    )
    cos, sin = jnp.cos(heading), jnp.sin(heading)
    return jnp.stack([cos * x - sin * y + ahead, sin * x + cos * y + aside, z], axis=1)


def planar(pose: jaxlie.SE3) -> jaxlie.SE2:
    """The planar pose: position and heading of a pose in space."""
    turn = pose.rotation().as_matrix()
    heading = jnp.arctan2(turn[1, 0], turn[0, 0])
    x, y, _ = pose.translation()
    return jaxlie.SE2.from_xy_theta(x, y, heading)


def spatial(pose: jaxlie.SE2) -> jaxlie.SE3:
    """The pose on the ground, upright."""
    turn = jaxlie.SO3.from_z_radians(pose.rotation().as_radians())
    x, y = pose.translation()
    return jaxlie.SE3.from_rotation_and_translation(turn, jnp.stack([x, y, jnp.zeros_like(x)]))
