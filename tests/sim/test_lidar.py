"""Known answers, laws and statistics of a sweep, nearly all with one compiled program of 16 rings and 64 columns."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.sim.lidar import LidarParams, columns, elevations, front_pair, sweep
from urbanjax.sim.scenery.scenery import Scenery
from urbanjax.types import Objects, VehicleState, as_arrays

K, V = 16, 2
EXACT = as_arrays(LidarParams(pattern="vlp_16", columns=64, nearby=12, noise=0.0, dropout=0.0))
NOISY = as_arrays(EXACT.replace(noise=0.03, dropout=0.05))
SWEEP = jax.jit(sweep)
KEY = jax.random.key(0)
WALL = {"x": 20.0, "half": (0.5, 200.0), "top": 60.0}
ROOM = [WALL, WALL | {"x": -20.0}] + [{"y": y, "half": (200.0, 0.5), "top": 60.0} for y in (-20.0, 20.0)]


def prisms(*rows):
    rows = [{"x": 0.0, "y": 0.0, "heading": 0.0, "half": (1.0, 1.0), "bottom": 0.0, "top": 5.0} | row for row in rows]
    rows += [rows[0] | {"valid": False}] * (K - len(rows))
    column = {name: np.array([row[name] for row in rows]) for name in ("heading", "half", "bottom", "top")}
    centre = np.array([(row["x"], row["y"]) for row in rows])
    valid = np.array([row.get("valid", True) for row in rows])
    shine = 0.3 + np.arange(K) / 100
    return as_arrays(Scenery(centre=centre, reflectivity=shine, valid=valid, **column))


def cars(*rows):
    rows = [*rows, *[(0.0, 0.0, 0.0, 0.0)] * (V - len(rows))]
    x, y, heading, speed = np.array(rows).T
    valid = np.arange(V) < len([row for row in rows if any(row)])
    return as_arrays(Objects(np.stack([x, y], -1), heading, speed, np.full(V, 4.5), np.full(V, 1.9), valid))


def ego(x=0.0, y=0.0, heading=0.0, speed=0.0):
    return as_arrays(VehicleState(np.array([x, y]), heading, speed, 0.0, 0.0))


def scan_of(surroundings, vehicles=None, at=None, yaw_rate=0.0, params=EXACT, key=KEY):
    vehicles, at = cars() if vehicles is None else vehicles, ego() if at is None else at
    return jax.device_get(SWEEP(params, surroundings, vehicles=vehicles, ego=at, yaw_rate=as_arrays(yaw_rate), key=key))


def body_at(at, yaw_rate, time):
    """Poses (x, y, heading) [A, 3] of the body at times [A] <= 0, in closed form and double precision."""
    (x, y), heading, speed = (np.asarray(v, float) for v in (at.position, at.heading, at.speed))
    turned = heading + yaw_rate * time
    if yaw_rate == 0:
        return np.stack([x + speed * time * np.cos(heading), y + speed * time * np.sin(heading), turned], -1)
    radius = speed / yaw_rate
    dx, dy = radius * (np.sin(turned) - np.sin(heading)), radius * (np.cos(heading) - np.cos(turned))
    return np.stack([x + dx, y + dy, turned], -1)


def in_map(scan, at, yaw_rate, params=EXACT):
    """Points [R, A, 3] of a scan where they were, by the true motion."""
    x, y, heading = body_at(at, yaw_rate, np.asarray(scan.time[0], float)).T
    p = np.asarray(scan.position, float)
    yaw = float(params.yaw)
    px = p[..., 0] * np.cos(yaw) - p[..., 1] * np.sin(yaw) + float(params.x)
    py = p[..., 0] * np.sin(yaw) + p[..., 1] * np.cos(yaw) + float(params.y)
    cos, sin = np.cos(heading), np.sin(heading)
    return np.stack([x + cos * px - sin * py, y + sin * px + cos * py, p[..., 2] + float(params.z)], -1)


def test_columns_turn_clockwise_from_behind_and_end_now():
    azimuth, time = columns(EXACT)
    assert azimuth[0] == pytest.approx(np.pi * (1 - 2 / 64))
    assert (np.diff(azimuth) < 0).all()
    assert time[-1] == 0
    assert time[0] == pytest.approx(-0.1 * 63 / 64)
    steps = np.degrees(np.diff(elevations(LidarParams())))
    np.testing.assert_allclose(steps, -22.5 / 127)


def test_wall_and_ground_are_where_they_are():
    scan = scan_of(prisms(WALL))
    azimuth, up = np.asarray(columns(EXACT)[0]), elevations(EXACT)
    face = (19.5 - 1.2) / np.cos(azimuth)[None, :]
    ground = np.where(up < 0, -1.9 / np.tan(np.where(up < 0, up, -1)), np.inf)[:, None]
    expected = np.minimum(np.where(np.abs(azimuth) < 1.2, face, np.inf), np.where(ground < 60, ground, np.inf))
    seen = (expected < 1e3) & (expected / np.cos(up)[:, None] < 120)
    sure = np.abs(np.abs(azimuth) - 1.3) > 0.15  # columns between meet the wall far away
    np.testing.assert_array_equal(scan.valid[:, sure], seen[:, sure])
    flat = np.hypot(scan.position[..., 0], scan.position[..., 1])
    np.testing.assert_allclose(flat[:, sure][seen[:, sure]], expected[:, sure][seen[:, sure]], rtol=2e-5)
    on_ground = scan.valid & (ground <= expected) & sure
    np.testing.assert_allclose(scan.position[on_ground][:, 2], -1.9, atol=1e-5)
    np.testing.assert_allclose(scan.reflectivity[on_ground], 0.2)
    np.testing.assert_allclose(scan.reflectivity[scan.valid & sure & ~on_ground], 0.3, rtol=1e-6)
    assert (scan.position[~scan.valid] == 0).all()


def test_points_taken_on_the_way_lie_on_the_walls_once_the_motion_is_undone():
    at, yaw_rate = ego(2.0, -3.0, 0.3, speed=15.0), 0.5
    scan = scan_of(prisms(*ROOM), at=at, yaw_rate=yaw_rate)

    def off(points):
        return np.abs(np.abs(points[..., :2]).max(-1) - 19.5)[scan.valid & (points[..., 2] > 0.01)]

    assert off(in_map(scan, at, yaw_rate)).max() < 1e-3
    still = in_map(scan.__class__(scan.position, scan.reflectivity, 0 * scan.time, scan.valid), at, yaw_rate)
    assert off(still).max() > 1.0


def test_vehicle_hides_the_wall_and_moves_during_the_sweep():
    vehicles = cars((12.0, 0.0, 0.0, 20.0))
    scan = scan_of(prisms(WALL), vehicles)
    ahead = np.abs(columns(EXACT)[0]) < 0.05
    rear = 12.0 - 2.25 + 20.0 * scan.time[:, ahead] - 1.2
    height = scan.position[:, ahead, 2] + 1.9
    on_car = scan.valid[:, ahead] & (scan.reflectivity[:, ahead] == np.float32(0.5))
    face = on_car & (height < 1.499)
    assert face.sum() >= 2
    np.testing.assert_allclose(scan.position[:, ahead, 0][face], rear[face], atol=1e-4)
    assert (height[on_car] < 1.501).all()
    assert (height[on_car] > 0.249).all()
    alone = scan_of(prisms(WALL), vehicles.replace(valid=jnp.zeros(V, bool)))
    assert (np.linalg.norm(alone.position, axis=-1)[:, ahead][on_car] > 3).all()
    np.testing.assert_array_equal(scan.position[:, ~ahead][:, :20], alone.position[:, ~ahead][:, :20])


def test_low_box_is_met_on_top_and_a_crown_from_below():
    box = {"x": 8.0, "half": (2.0, 2.0), "top": 1.0}
    crown = {"x": 12.0, "half": (3.0, 3.0), "bottom": 3.0, "top": 9.0}
    scan = scan_of(prisms(box, crown))
    ahead = int(np.argmin(np.abs(columns(EXACT)[0])))
    x, z = scan.position[:, ahead, 0] + 1.2, scan.position[:, ahead, 2] + 1.9
    slope = np.tan(elevations(EXACT))
    top = (x > 6.01) & (x < 9.99)
    assert top.sum() >= 1
    np.testing.assert_allclose(z[top & (slope < 0)], 1.0, atol=1e-5)
    below = (x > 9.01) & (slope > 0) & scan.valid[:, ahead]
    assert below.sum() >= 1
    np.testing.assert_allclose(z[below & (x < 14.9)], 3.0, atol=1e-4)


def test_noise_and_dropout_have_the_given_size():
    exact = scan_of(prisms(*ROOM))
    assert exact.valid.all()
    scans = [scan_of(prisms(*ROOM), params=NOISY, key=jax.random.key(k)) for k in range(12)]
    lost = 1 - np.mean([scan.valid for scan in scans])
    reach = np.linalg.norm(exact.position, axis=-1)
    error = np.concatenate([(np.linalg.norm(scan.position, axis=-1) - reach)[scan.valid] for scan in scans])
    n = 12 * 16 * 64
    assert lost == pytest.approx(0.05, abs=4 * np.sqrt(0.05 * 0.95 / n))
    assert error.std() == pytest.approx(0.03, rel=4 / np.sqrt(2 * n))
    assert abs(error.mean()) < 4 * 0.03 / np.sqrt(n)
    unit = [scan.position / np.maximum(np.linalg.norm(scan.position, axis=-1, keepdims=True), 1e-9) for scan in scans]
    same = exact.position / reach[..., None]
    assert max(np.abs((u - same)[scan.valid]).max() for u, scan in zip(unit, scans, strict=True)) < 1e-6


def test_same_key_same_scan():
    first, again = (scan_of(prisms(*ROOM), params=NOISY) for _ in range(2))
    other = scan_of(prisms(*ROOM), params=NOISY, key=jax.random.key(1))
    jax.tree.map(np.testing.assert_array_equal, first, again)
    assert (first.position != other.position).any()


def test_five_kilometres_from_the_origin_change_nothing():
    rng = np.random.default_rng(0)
    rows = [
        {"x": x, "y": y, "heading": h, "half": tuple(f), "top": t}
        for x, y, h, f, t in zip(
            *rng.uniform(-40, 40, (2, 12)),
            *rng.uniform(-3, 3, (1, 12)),
            *[rng.uniform(0.5, 4, (12, 2))],
            rng.uniform(1, 9, 12),
            strict=True,
        )
    ]
    here = scan_of(prisms(*rows), cars((9.0, 3.0, 0.2, 5.0)), ego(0.0, 0.0, 0.4, 9.0), 0.2)
    moved = [row | {"x": row["x"] + 5000.0, "y": row["y"] - 4000.0} for row in rows]
    there = scan_of(prisms(*moved), cars((5009.0, -3997.0, 0.2, 5.0)), ego(5000.0, -4000.0, 0.4, 9.0), 0.2)
    assert (here.valid != there.valid).mean() < 0.005
    both = here.valid & there.valid
    error = np.linalg.norm(here.position - there.position, axis=-1)[both]
    assert np.mean(error < 2e-3) > 0.995


def test_farther_prisms_than_the_nearest_are_left_out():
    near = [{"x": 10 * np.cos(a), "y": 10 * np.sin(a)} for a in np.arange(12) * np.pi / 6]
    far = [{"x": 50 * np.cos(a), "y": 50 * np.sin(a), "half": (6.0, 6.0), "top": 9.0} for a in (0.26, 1.31, 2.88, 4.45)]
    jax.tree.map(np.testing.assert_array_equal, scan_of(prisms(*near, *far)), scan_of(prisms(*near)))
    assert (scan_of(prisms(*far)).reflectivity > 0.25).any()


def test_batch_is_a_loop():
    ahead = [ego(0.0, 0.0, 0.1, 3.0), ego(5.0, 2.0, -0.4, 8.0)]
    keys = jax.random.split(KEY, 2)
    street = prisms(*ROOM, {"x": 6.0, "y": 5.0})
    rate = jnp.asarray(0.1)
    egos = jax.tree.map(lambda *v: jnp.stack(v), *ahead)
    many = jax.vmap(lambda ego, key: sweep(NOISY, street, vehicles=cars(), ego=ego, yaw_rate=rate, key=key))
    stacked = jax.device_get(jax.jit(many)(egos, keys))
    for k in range(2):
        one = scan_of(street, at=ahead[k], yaw_rate=0.1, params=NOISY, key=keys[k])
        np.testing.assert_array_equal(one.valid, stacked.valid[k])
        np.testing.assert_allclose(one.position, stacked.position[k], atol=1e-4)


def test_another_scene_compiles_nothing():
    scan_of(prisms(*ROOM))
    compiled = []

    def count(event, duration, **_):
        if event.endswith("backend_compile_duration"):
            compiled.append(event)

    others = {"vehicles": cars((9.0, 3.0, 0.2, 5.0)), "ego": ego(1.0, 2.0, 0.3, 4.0), "yaw_rate": as_arrays(0.3)}
    surroundings, key = prisms(WALL), jax.random.key(5)
    jax.monitoring.register_event_duration_secs_listener(count)
    try:
        SWEEP(NOISY, surroundings, **others, key=key)
    finally:
        jax.monitoring.unregister_event_duration_listener(count)
    assert not compiled


def test_range_has_the_derivative_of_the_motion_towards_the_wall():
    column = int(np.argmin(np.abs(columns(EXACT)[0])))

    def ahead(x, speed):
        at = ego().replace(position=jnp.stack([x, jnp.zeros(())]), speed=speed)
        scan = sweep(EXACT, prisms(*ROOM), vehicles=cars(), ego=at, yaw_rate=jnp.zeros(()), key=KEY)
        return scan.position[0, column, 0]

    by_x, by_speed = jax.jit(jax.jacfwd(ahead, argnums=(0, 1)))(jnp.zeros(()), jnp.asarray(4.0))
    assert by_x == pytest.approx(-1.0, abs=1e-5)
    assert by_speed == pytest.approx(-float(columns(EXACT)[1][column]), abs=1e-5)


def test_front_pair_looks_to_both_sides():
    left, right = front_pair()
    assert left.y == -right.y > 0
    assert left.yaw == -right.yaw > 0
    assert left.pattern == right.pattern == "vlp_16"
    assert left.x == right.x
