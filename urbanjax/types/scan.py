"""One sweep of a LiDAR."""

from jax import Array

from urbanjax.types.struct import pytree

Number = float | Array
Mount = tuple[Number, Number, Number, Number]  # x, y, z (m) above the ground and yaw (rad), from the rear axle


@pytree
class Scan:
    """R rings by A columns of returns, rings from the top, columns in the order in which they are taken.

    Each point is given where the sensor saw it at that moment: while the vehicle moves, the points of one sweep belong
    to different poses of the sensor (rolling shutter). Scans without rings have R = 1.
    """

    position: Array  # [R, A, 3] m, in the LiDAR frame at the time of the point
    reflectivity: Array  # [R, A] share of the light that comes back, 0 to 1
    time: Array  # [R, A] s, since the stamp of the scan, which is the end of the sweep: not positive
    valid: Array  # [R, A] bool, there was a return
