"""A spinning LiDAR among prisms: one sweep with rolling shutter, noise and drop-out.

The pose is planar, so that all rings of a column look the same way in plan. Each column is therefore cut with the
footprints once, in two dimensions, and its rings then choose among the few footprints that it meets first.
"""

from typing import ClassVar

import jax
import jax.numpy as jnp
import jaxlie
import numpy as np
from jax import Array, lax
from jaxtyping import Float

from urbanjax.sim.scenery.scenery import Scenery
from urbanjax.types import POSITIVE, SHARE, Mount, Objects, Scan, VehicleState, field, pytree, static

# Elevations of the rings [degrees], from the top.
PATTERNS = {
    "os2_128": tuple(np.linspace(11.25, -11.25, 128).tolist()),
    "vlp_16": tuple(np.linspace(15.0, -15.0, 16).tolist()),
}
FAR = float(np.finfo(np.float32).max) / 4  # m, "nothing there": finite, so that sums of a few stay finite
PARALLEL = 1e-9  # slope of a ray along a surface: smaller ones count as this one, and nothing is divided by 0


@pytree
class LidarParams:
    """One unit, level, mounted on the body frame (rear axle, on the ground). The defaults are an OS2 on the roof."""

    PINNED: ClassVar[dict[str, str]] = {"*": "fact: of the sensor"}

    x: float = 1.2  # m, forward of the rear axle
    y: float = 0.0  # m, to the left
    z: float = 1.9  # m, above the ground
    yaw: float = 0.0  # rad
    min_range: float = 1.0  # m
    max_range: float = 120.0  # m
    ground_range: float = 60.0  # m, beyond which the ground, met at a grazing angle, gives no return
    ground_reflectivity: float = 0.2
    noise: float = 0.03  # m, standard deviation along the ray
    dropout: float = field(default=0.05, metadata=SHARE)  # share of the returns that are lost
    period: float = field(default=0.1, metadata=POSITIVE)  # s, of one sweep
    vehicle_bottom: float = 0.25  # m, under the body of other vehicles
    vehicle_top: float = 1.5  # m, their roof
    vehicle_reflectivity: float = 0.5
    pattern: str = static(default="os2_128", metadata={"choices": tuple(PATTERNS)})
    columns: int = static(default=1024)  # of one turn
    nearby: int = static(default=160)  # prisms that are looked at in one sweep, the nearest ones
    layers: int = static(default=8)  # footprints that a column can meet, the first ones

    @property
    def mount(self) -> Mount:
        """Its place on the vehicle."""
        return self.x, self.y, self.z, self.yaw


def front_pair() -> tuple[LidarParams, LidarParams]:
    """Two units of 16 rings on the left and right front corners of the roof, looking half to their side."""
    left = LidarParams(pattern="vlp_16", x=2.0, y=0.6, z=1.7, yaw=0.8)
    return left, left.replace(y=-0.6, yaw=-0.8)


def elevations(params: LidarParams) -> Float[np.ndarray, " r"]:
    """Elevation [R] of each ring in radians, from the top."""
    return np.radians(PATTERNS[params.pattern])


def columns(params: LidarParams) -> tuple[Float[Array, " a"], Float[Array, " a"]]:
    """Azimuth [A] (rad, in the LiDAR frame) and time [A] (s, since the end of the sweep) of each column.

    The head turns clockwise and begins straight behind.
    """
    back = jnp.arange(params.columns - 1, -1, -1) / params.columns  # share of the sweep that is still to come
    return (2 * back - 1) * jnp.pi, -back * params.period


def sweep(
    params: LidarParams,
    surroundings: Scenery,
    *,
    vehicles: Objects | None,
    ego: VehicleState,
    yaw_rate: Float[Array, ""],
    key: Array,
) -> Scan:
    """The scan [R, A] of one turn of the head, which ends when the vehicle is at `ego`.

    Over the sweep the ego keeps its speed and yaw rate (rad/s), and vehicles their velocity. Each ray returns from the
    first of: the nearest `nearby` prisms, the vehicles, the ground z = 0. Beyond `max_range` nothing returns, and from
    the ground nothing beyond `ground_range`. Vehicles do not include the ego. Points have the derivative of the surface
    that they lie on; which one that is, and what is lost, is a hard choice. Args: surroundings, prisms in the map
    frame; vehicles, other road users at the end of the sweep, or None; ego, likewise; yaw_rate [] rad/s, its own; key,
    of noise and drop-out.
    """
    azimuth, time = columns(params)
    rays = _rays(params, ego.speed, yaw_rate, azimuth, time)
    prisms = _nearest(surroundings, ego.position, params.nearby)
    if vehicles is not None:
        prisms = jnp.concatenate([prisms, _boxes(vehicles, ego.position, params)], axis=1)
    surfaces = _surfaces(_seen_from(prisms, ego.heading), rays, time, params)
    return _returns(surfaces, azimuth, time, params, key)


@pytree
class _Rays:
    """Columns in plan, in the body frame at the end of the sweep."""

    origin: Array  # [A, 2] m
    way: Array  # [A, 2] unit vectors


def _rays(params: LidarParams, speed: Array, yaw_rate: Array, azimuth: Array, time: Array) -> _Rays:
    """The columns [A] of a body with constant speed and yaw rate."""
    mount = jaxlie.SE2.from_xy_theta(params.x, params.y, params.yaw)

    def look(azimuth: Array, time: Array) -> _Rays:
        T_end_sensor = jaxlie.SE2.exp(time * jnp.stack([speed, jnp.zeros_like(speed), yaw_rate])) @ mount
        way = jnp.stack([jnp.cos(azimuth), jnp.sin(azimuth)])
        return _Rays(T_end_sensor.translation(), T_end_sensor.rotation() @ way)

    return jax.vmap(look)(azimuth, time)


# Rows of a table of prisms: where, which way, how large, how fast, and whether at all.
X, Y, COS, SIN, LENGTH, WIDTH, BOTTOM, TOP, REFLECTIVITY, V_X, V_Y, VALID = range(12)


def _nearest(surroundings: Scenery, position: Array, n: int) -> Array:
    """[12, K] the n prisms nearest to a position, which becomes their origin; axes as in the map."""
    away = surroundings.centre - position[None, :]
    half = surroundings.half
    gap = jnp.sqrt(jnp.sum(away**2, axis=1)) - jnp.sqrt(jnp.sum(half**2, axis=1))
    n = min(n, len(gap))
    # Without the barrier XLA sorts in full on the CPU.
    _, index = lax.optimization_barrier(lax.top_k(jnp.where(surroundings.valid, -gap, -FAR), n))
    zero = jnp.zeros_like(gap)
    heading = surroundings.heading
    columns = [away[:, 0], away[:, 1], jnp.cos(heading), jnp.sin(heading), half[:, 0], half[:, 1], surroundings.bottom]
    columns += [surroundings.top, surroundings.reflectivity, zero, zero, surroundings.valid.astype(gap.dtype)]
    return jnp.stack(columns, axis=1)[index].T


def _boxes(vehicles: Objects, position: Array, params: LidarParams) -> Array:
    """[12, V] the vehicles as prisms, likewise."""
    away = vehicles.position - position[None, :]
    cos, sin = jnp.cos(vehicles.heading), jnp.sin(vehicles.heading)
    one = jnp.ones_like(cos)
    rows = [away[:, 0], away[:, 1], cos, sin, vehicles.length / 2, vehicles.width / 2, params.vehicle_bottom * one]
    rows += [params.vehicle_top * one, params.vehicle_reflectivity * one, vehicles.speed * cos, vehicles.speed * sin]
    return jnp.stack([*rows, vehicles.valid.astype(one.dtype)])


def _seen_from(prisms: Array, heading: Array) -> Array:
    """[12, K] the table in axes that are turned by `heading`."""
    cos, sin = jnp.cos(heading), jnp.sin(heading)
    turned = prisms
    for a, b in ((X, Y), (COS, SIN), (V_X, V_Y)):
        turned = turned.at[a].set(cos * prisms[a] + sin * prisms[b]).at[b].set(cos * prisms[b] - sin * prisms[a])
    return turned


@pytree
class _Surfaces:
    """What each column meets, the first ones."""

    enter: Array  # [S, A] m, distance in plan
    leave: Array  # [S, A] m; less than enter: nothing is met
    bottom: Array  # [S, A] m
    top: Array  # [S, A] m
    reflectivity: Array  # [S, A]


def _surfaces(prisms: Array, rays: _Rays, time: Array, params: LidarParams) -> _Surfaces:
    """The footprints [K] that rays [A] meet first; a prism moves with its velocity."""
    p = prisms[:, :, None]
    time = time[None, :]
    x = p[X] + p[V_X] * time - rays.origin[None, :, 0]
    y = p[Y] + p[V_Y] * time - rays.origin[None, :, 1]
    ray_x, ray_y = rays.way[None, :, 0], rays.way[None, :, 1]
    along = _span(x * p[COS] + y * p[SIN], ray_x * p[COS] + ray_y * p[SIN], p[LENGTH])
    across = _span(y * p[COS] - x * p[SIN], ray_y * p[COS] - ray_x * p[SIN], p[WIDTH])
    enter = jnp.maximum(jnp.maximum(along[0], across[0]), 0)
    leave = jnp.minimum(along[1], across[1])
    met = (leave > enter) & (enter < params.max_range) & (p[VALID] > 0)
    index, there = _first(enter, met, params.layers)

    def take(values: Array) -> Array:
        return jnp.take_along_axis(values, index, axis=0)

    return _Surfaces(
        enter=take(enter),
        leave=jnp.where(there, take(leave), -1),
        bottom=prisms[BOTTOM][index],
        top=prisms[TOP][index],
        reflectivity=prisms[REFLECTIVITY][index],
    )


def _span(offset: Array, slope: Array, half: Array) -> tuple[Array, Array]:
    """The distances between which a ray is within `half` of a line's foot: |distance * slope - offset| <= half."""
    inverse = 1 / jnp.where(jnp.abs(slope) < PARALLEL, PARALLEL, slope)
    middle, reach = offset * inverse, half * jnp.abs(inverse)
    return middle - reach, middle + reach


def _first(distance: Array, met: Array, n: int) -> tuple[Array, Array]:
    """Rows [n, A] of the n smallest distances [K, A] >= 0 of each column, in order, and whether there are so many.

    Non-negative floats are ordered like their bits: with the row in the last bits (1 mm of order at 100 m), one integer
    holds both, and inserting row after row into n ordered ones is many times faster than a sort.
    """
    k = len(distance)
    low = (1 << max(k - 1, 1).bit_length()) - 1
    nothing = jnp.iinfo(jnp.int32).max
    bits = lax.bitcast_convert_type(distance.astype(jnp.float32), jnp.int32)
    code = jnp.where(met, (bits & ~low) | jnp.arange(k, dtype=jnp.int32)[:, None], nothing)

    def insert(ordered: Array, new: Array) -> tuple[Array, None]:
        before = jnp.concatenate([jnp.full_like(ordered[:1], -1), ordered[:-1]])
        return jnp.clip(new[None, :], before, ordered), None

    ordered, _ = lax.scan(insert, jnp.full((n, code.shape[1]), nothing), code)
    there = ordered < nothing
    return jnp.where(there, ordered & low, 0), there


def _returns(surfaces: _Surfaces, azimuth: Array, time: Array, params: LidarParams, key: Array) -> Scan:
    """The scan of all rings of columns that meet these surfaces."""
    elevation = jnp.asarray(elevations(params), azimuth.dtype)[:, None]
    cos = jnp.cos(elevation)
    distance, reflectivity = _hit(surfaces, jnp.tan(elevation), params)
    noise_key, drop_key = jax.random.split(key)
    shape = distance.shape
    reach = distance / cos
    there = (reach < params.max_range) & (jax.random.uniform(drop_key, shape, reach.dtype) >= params.dropout)
    reach = reach + params.noise * jax.random.normal(noise_key, shape, reach.dtype)
    there &= reach > params.min_range
    reach = jnp.where(there, reach, 0)
    flat = reach * cos
    x, y = flat * jnp.cos(azimuth)[None, :], flat * jnp.sin(azimuth)[None, :]
    return Scan(
        position=jnp.stack([x, y, reach * jnp.sin(elevation)], axis=-1),
        reflectivity=jnp.where(there, reflectivity, 0),
        time=jnp.broadcast_to(time[None, :], shape),
        valid=there,
    )


def _hit(surfaces: _Surfaces, slope: Array, params: LidarParams) -> tuple[Array, Array]:
    """Distance in plan [R, A] (m, FAR for none) and reflectivity of what rays of slopes [R, 1] hit first."""
    rise = 1 / jnp.where(jnp.abs(slope) < PARALLEL, PARALLEL, slope)  # distance in plan per metre of height
    ground = jnp.where(slope < 0, -params.z * rise, FAR)
    ground = jnp.where(ground < params.ground_range, ground, FAR)
    distance = jnp.broadcast_to(ground, (len(slope), surfaces.enter.shape[1]))

    def nearer(best: tuple[Array, Array], at: _Surfaces) -> tuple[tuple[Array, Array], None]:
        distance, reflectivity = best
        low, high = (at.bottom[None, :] - params.z) * rise, (at.top[None, :] - params.z) * rise
        first = jnp.maximum(at.enter[None, :], jnp.minimum(low, high))
        last = jnp.minimum(at.leave[None, :], jnp.maximum(low, high))
        here = (first <= last) & (first < distance)
        distance = jnp.where(here, first, distance)
        return (distance, jnp.where(here, at.reflectivity[None, :], reflectivity)), None

    start = (distance, jnp.full_like(distance, params.ground_reflectivity))
    return lax.scan(nearer, start, surfaces)[0]
