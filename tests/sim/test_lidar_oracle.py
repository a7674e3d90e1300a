"""Every ray against a brute-force search in three dimensions and double precision."""

import jax
import numpy as np

from urbanjax.sim.lidar import LidarParams, columns, elevations, sweep
from urbanjax.sim.scenery.scenery import Scenery
from urbanjax.types import Objects, VehicleState, as_arrays

K, V = 16, 2
NEARBY = 12  # and no more stand: these are the shapes of test_lidar.py, which compile once
PARAMS = LidarParams(pattern="vlp_16", columns=64, nearby=NEARBY, noise=0.0, dropout=0.0, x=1.0, y=0.4, z=1.8, yaw=0.6)


def scene(seed):
    rng = np.random.default_rng(seed)
    place = rng.uniform(-16, 16, (K, 2))
    place += 7 * np.sign(place)
    bottom = np.where(rng.random(K) < 0.7, 0.0, rng.uniform(0.2, 4.0, K))
    heading, half = rng.uniform(-4, 4, K), rng.uniform(0.1, 5.0, (K, 2))
    top, shine = bottom + rng.uniform(0.3, 15.0, K), rng.uniform(0.3, 0.9, K)
    furniture = Scenery(place, heading, half, bottom, top, shine, np.arange(K) < NEARBY)
    where = rng.uniform(4.0, 40.0, V)[:, None] * rng.choice([-1, 1], (V, 2))
    turn, speed = rng.uniform(-3, 3, V), rng.uniform(0, 15, V)
    vehicles = Objects(where, turn, speed, np.full(V, 4.6), np.full(V, 1.9), rng.random(V) < 0.8)
    state = VehicleState(rng.uniform(-1, 1, 2), rng.uniform(-3, 3), rng.uniform(0, 15), 0.0, 0.0)
    return furniture, vehicles, state, rng.uniform(-0.6, 0.6)


def nearest(origin, ray, centre, heading, half, bottom, top):
    """Distances [A, R, K] along rays from origins to boxes, infinite where they miss, by slabs in the boxes' frames."""
    cos, sin = np.cos(heading), np.sin(heading)
    away = origin[:, None, None, :2] - centre
    local = [away[..., 0] * cos + away[..., 1] * sin, away[..., 1] * cos - away[..., 0] * sin]
    local += [np.broadcast_to(origin[:, None, None, 2] - (bottom + top) / 2, local[0].shape)]
    dx, dy, dz = (ray[..., None, k] for k in range(3))
    ways = [dx * cos + dy * sin, dy * cos - dx * sin, dz + 0 * cos]
    enter, leave = -np.inf, np.inf
    for at, way, size in zip(local, ways, (half[:, 0], half[:, 1], (top - bottom) / 2), strict=True):
        one, two = (-size - at) / way, (size - at) / way
        enter, leave = np.maximum(enter, np.minimum(one, two)), np.minimum(leave, np.maximum(one, two))
    return np.where((enter <= leave) & (enter > 0), enter, np.inf)


def oracle(furniture, vehicles, state, yaw_rate):
    """Ranges [R, A], infinite where nothing is met, and reflectivity."""
    azimuth, time = (np.asarray(v, float) for v in columns(PARAMS))
    up = elevations(PARAMS)
    heading = state.heading + yaw_rate * time
    radius = state.speed / yaw_rate
    x = state.position[0] + radius * (np.sin(heading) - np.sin(state.heading))
    y = state.position[1] + radius * (np.cos(state.heading) - np.cos(heading))
    at_x = x + PARAMS.x * np.cos(heading) - PARAMS.y * np.sin(heading)
    at_y = y + PARAMS.x * np.sin(heading) + PARAMS.y * np.cos(heading)
    origin = np.stack([at_x, at_y, np.full_like(at_x, PARAMS.z)], -1)
    angle = (heading + PARAMS.yaw + azimuth)[:, None]
    ray = np.stack([np.cos(up) * np.cos(angle), np.cos(up) * np.sin(angle), np.sin(up) + 0 * angle], -1)
    ground = np.where(up < 0, -PARAMS.z / np.sin(np.where(up < 0, up, -1)), np.inf)
    ground = np.where(ground * np.cos(up) < PARAMS.ground_range, ground, np.inf)
    best = np.broadcast_to(ground, angle.shape[:1] + up.shape)[..., None]
    shine = np.full(1, PARAMS.ground_reflectivity)
    f, v = furniture, vehicles
    reach = nearest(origin, ray, f.centre, f.heading, f.half, f.bottom, f.top)
    best, shine = np.concatenate([best, np.where(f.valid, reach, np.inf)], -1), np.concatenate([shine, f.reflectivity])
    velocity = v.speed[:, None] * np.stack([np.cos(v.heading), np.sin(v.heading)], -1)
    half = np.stack([v.length, v.width], -1) / 2
    moved = v.position + velocity * time[:, None, None, None]
    low, high = np.full(V, PARAMS.vehicle_bottom), np.full(V, PARAMS.vehicle_top)
    reach = nearest(origin, ray, moved, v.heading, half, low, high)
    best = np.concatenate([best, np.where(v.valid, reach, np.inf)], -1)
    shine = np.concatenate([shine, np.full(V, PARAMS.vehicle_reflectivity)])
    found = best.min(-1)
    found = np.where((found < PARAMS.max_range) & (found > PARAMS.min_range), found, np.inf)
    return found.T, shine[best.argmin(-1)].T


def test_rays_agree_with_brute_force():
    run = jax.jit(sweep)
    wrong, total, prisms = 0, 0, 0
    for seed in range(10):
        furniture, vehicles, state, yaw_rate = scene(seed)
        args = {"vehicles": as_arrays(vehicles), "ego": as_arrays(state), "yaw_rate": as_arrays(yaw_rate)}
        scan = jax.device_get(run(as_arrays(PARAMS), as_arrays(furniture), **args, key=jax.random.key(0)))
        reach, shine = oracle(furniture, vehicles, state, yaw_rate)
        there = np.isfinite(reach)
        found = np.linalg.norm(scan.position, axis=-1)
        close = np.abs(found - np.where(there, reach, 0)) < 0.01
        alike = np.abs(scan.reflectivity - np.where(there, shine, 0)) < 1e-5
        wrong += np.sum(~((there == scan.valid) & close & alike))
        total += there.size
        prisms += np.sum(there & (shine > 0.25))
    assert wrong / total < 0.005, (wrong, total)
    assert prisms / total > 0.2
