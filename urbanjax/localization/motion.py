"""Motion from wheel speed and yaw rate: arcs in the plane of the vehicle."""

import jax.numpy as jnp
import jaxlie
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import safe
from urbanjax.types import Odometry, Scan


def arc(speed: Float[Array, "*n"], yaw_rate: Float[Array, "*n"], *, time: Float[Array, "*n"]) -> Float[Array, "3 *n"]:
    """X (m), y (m) and heading (rad) of the body after some time, in its frame at time 0; exact for constant rates.

    Args: speed [N] m/s; yaw_rate [N] rad/s; time [N] s.
    """
    heading = yaw_rate * time
    chord = speed * time * safe.sinc(heading / 2)
    return jnp.stack([chord * jnp.cos(heading / 2), chord * jnp.sin(heading / 2), heading])


def travelled(odometry: Odometry, time: float | Float[Array, ""]) -> jaxlie.SE3:
    """The motion of the body during some time: T_before_after.

    Args: odometry, whose speed and yaw rate hold meanwhile; time [s].
    """
    x, y, heading = arc(odometry.speed, odometry.yaw_rate, time=jnp.asarray(time, odometry.speed.dtype))
    rotation = jaxlie.SO3.from_z_radians(heading)
    return jaxlie.SE3.from_rotation_and_translation(rotation, jnp.stack([x, y, jnp.zeros_like(x)]))


def propagate(T_map_body: jaxlie.SE3, odometry: Odometry, *, time: float | Float[Array, ""]) -> jaxlie.SE3:
    """The pose `time` s later: what the localizer puts out between two scans, at the rate of the wheel sensors.

    Args: T_map_body, at the last scan; odometry, since then; time [s] since then.
    """
    return T_map_body @ travelled(odometry, time)


def deskew(scan: Scan, T_body_lidar: jaxlie.SE3, *, odometry: Odometry) -> Float[Array, "n 3"]:
    """The points [N, 3] (m) of a sweep in the body frame at its stamp, the motion during the sweep taken out.

    Args: scan, with the time of each point; T_body_lidar, the mount; odometry, whose speed and yaw rate held during the
    sweep.
    """
    flat = scan.position.reshape(-1, 3)
    r, t = T_body_lidar.rotation().as_matrix(), T_body_lidar.translation()
    x, y, z = (sum((r[i, k] * flat[:, k] for k in range(1, 3)), r[i, 0] * flat[:, 0] + t[i]) for i in range(3))
    time = scan.time.reshape(-1)
    ahead, aside, heading = arc(
        jnp.broadcast_to(odometry.speed, time.shape), jnp.broadcast_to(odometry.yaw_rate, time.shape), time=time
    )
    cos, sin = jnp.cos(heading), jnp.sin(heading)
    return jnp.stack([cos * x - sin * y + ahead, sin * x + cos * y + aside, z], axis=1)


def planar(T_map_body: jaxlie.SE3) -> jaxlie.SE2:
    """The planar pose: position and heading of a pose in space. Args: T_map_body, in space."""
    rotation = T_map_body.rotation().as_matrix()
    heading = jnp.arctan2(rotation[1, 0], rotation[0, 0])
    x, y, _ = T_map_body.translation()
    return jaxlie.SE2.from_xy_theta(x, y, heading)


def spatial(T_map_body: jaxlie.SE2) -> jaxlie.SE3:
    """The pose on the ground, upright. Args: T_map_body, in the plane."""
    rotation = jaxlie.SO3.from_z_radians(T_map_body.rotation().as_radians())
    x, y = T_map_body.translation()
    return jaxlie.SE3.from_rotation_and_translation(rotation, jnp.stack([x, y, jnp.zeros_like(x)]))
