"""The published scores once more: float64, NumPy, one drive, step by step, from the definitions alone."""

import numpy as np
from scipy.integrate import simpson
from scipy.signal import savgol_filter


def corners(position, heading, length, width):
    """Counter-clockwise from the front left."""
    along, left = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
    signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    return np.array([position + a * length / 2 * along + b * width / 2 * left for a, b in signs])


def _cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _inside(points, polygon):
    """Whether points [.., n, 2] lie in a convex counter-clockwise polygon [.., m, 2]."""
    edges = np.roll(polygon, -1, axis=-2) - polygon
    away = points[..., :, None, :] - polygon[..., None, :, :]
    return np.all(_cross(edges[..., None, :, :], away) >= 0, axis=-1)


def intersect(one, polygon):
    """Whether chains or polygons [.., n, 2] meet convex ones [.., m, 2]: a corner within, or two edges that cross."""
    if one.shape[-2] == 2:  # a chain of a single edge
        starts, edges = one[..., :1, :], one[..., 1:, :] - one[..., :1, :]
    else:
        starts, edges = one, np.roll(one, -1, axis=-2) - one
    theirs = np.roll(polygon, -1, axis=-2) - polygon
    a, u = starts[..., :, None, :], edges[..., :, None, :]
    b, w = polygon[..., None, :, :], theirs[..., None, :, :]
    apart = _cross(u, b - a) * _cross(u, b + w - a) > 0
    apart |= _cross(w, a - b) * _cross(w, a + u - b) > 0
    parallel = np.abs(_cross(u, w)) < 1e-12
    crossing = np.any(~apart & ~parallel, axis=(-1, -2))
    corner = np.any(_inside(one, polygon), axis=-1)
    if one.shape[-2] > 2:
        corner |= np.any(_inside(polygon, one), axis=-1)
    return crossing | corner


def ego_box(facts, t):
    ego = facts.ego
    return corners(ego.position[t], ego.heading[t], ego.length[t], ego.width[t])


def other_box(facts, t, v):
    others = facts.others
    return corners(others.position[t, v], others.heading[t, v], others.length[t, v], others.width[t, v])


def touch(facts, t, v):
    ego, others = facts.ego, facts.others
    far = np.hypot(ego.length[t], ego.width[t]) / 2 + np.hypot(others.length[t, v], others.width[t, v]) / 2
    if not others.valid[t, v] or np.linalg.norm(others.position[t, v] - ego.position[t]) > far:
        return False
    return bool(intersect(ego_box(facts, t), other_box(facts, t, v)))


def angle(facts, t, v, vehicle):
    """Of the other's centre, seen from the rear axle, off the heading [rad]."""
    ego = facts.ego
    forward = np.array([np.cos(ego.heading[t]), np.sin(ego.heading[t])])
    rear = ego.position[t] - (vehicle.length / 2 - vehicle.rear_overhang) * forward
    away = facts.others.position[t, v] - rear
    return np.arccos(np.clip(forward @ away / np.linalg.norm(away), -1, 1))


def at_fault_events(facts, vehicle):
    """All first collisions as (step, other, at fault)."""
    events, collided = [], set()
    for t in range(int(facts.alive.sum())):
        for v in range(facts.others.valid.shape[1]):
            if v in collided or not touch(facts, t, v):
                continue
            collided.add(v)
            if facts.ego.speed[t] <= 0.05:
                fault = False
            elif facts.others.speed[t, v] <= 0.05:
                fault = True
            elif angle(facts, t, v, vehicle) > np.deg2rad(150):
                fault = False
            elif intersect(ego_box(facts, t)[[0, 3]], other_box(facts, t, v)):
                fault = True
            else:
                fault = not facts.in_one_lane[t]
            events.append((t, v, fault))
    return events


def ttc(facts, t, vehicle, events):
    if any(step == t and fault for step, _, fault in events):
        return 0.0
    ego, others = facts.ego, facts.others
    if ego.speed[t] <= 0.005:
        return np.inf
    collided = {v for step, v, _ in events if step <= t}
    times = np.arange(0.1, 3.0, 0.1)
    least = np.inf
    for v in range(others.valid.shape[1]):
        if not others.valid[t, v] or v in collided:
            continue
        off = angle(facts, t, v, vehicle)
        wide = (not facts.in_one_lane[t]) or facts.in_junction[t]
        if not (off < np.deg2rad(30) or (wide and not off > np.deg2rad(150))):
            continue
        own = ego.speed[t] * np.array([np.cos(ego.heading[t]), np.sin(ego.heading[t])])
        their = others.speed[t, v] * np.array([np.cos(others.heading[t, v]), np.sin(others.heading[t, v])])
        mine = ego_box(facts, t)[None] + times[:, None, None] * own
        theirs = other_box(facts, t, v)[None] + times[:, None, None] * their
        hits = np.flatnonzero(intersect(mine, theirs))
        if hits.size:
            least = min(least, times[hits[0]])
    return least


def smoothed(values, window, order, derivative=0, period=1.0):
    window = min(window, len(values))
    return savgol_filter(values, window_length=window, polyorder=order, deriv=derivative, delta=period)


def comfort_series(facts):
    n = int(facts.alive.sum())
    period = np.mean(np.diff(facts.time[:n]))
    along, across = facts.acceleration[:n], (facts.ego.speed * facts.yaw_rate)[:n]
    heading = np.unwrap(facts.ego.heading[:n])

    def jerk(values):
        return smoothed(smoothed(values, 8, 2), 15, 2, 1, period)

    return {
        "longitudinal": smoothed(along, 8, 2),
        "lateral": smoothed(across, 8, 2),
        "jerk": jerk(np.hypot(along, across)),
        "longitudinal_jerk": jerk(along),
        "yaw_rate": smoothed(heading, 5, 2, 1, period),
        "yaw_acceleration": smoothed(heading, 5, 3, 2, period),
    }


BOUNDS = {
    "longitudinal": (-4.05, 2.40),
    "lateral": (-4.89, 4.89),
    "jerk": (-8.37, 8.37),
    "longitudinal_jerk": (-4.13, 4.13),
    "yaw_rate": (-0.95, 0.95),
    "yaw_acceleration": (-1.93, 1.93),
}


def nuplan(facts, vehicle):
    """The columns of the score and the series they are made of."""
    n = int(facts.alive.sum())
    events = at_fault_events(facts, vehicle)
    faults = [(t, v) for t, v, fault in events if fault]
    period = np.mean(np.diff(facts.time[:n]))
    back = round(1 / period)
    steps = [0.0] + [
        (facts.along[t] + facts.along[t - 1]) / 2 * (facts.time[t] - facts.time[t - 1]) for t in range(1, n)
    ]
    advance = np.array([sum(steps[max(0, t - back) : t + 1]) for t in range(n)])
    against = abs(min(advance))
    way, reference = facts.station[n - 1] - facts.station[0], facts.goal - facts.station[0]
    ratio = 0.0 if way < -2 else min(1.0, max(way, 2.0) / max(reference, 2.0))
    times = np.array([ttc(facts, t, vehicle, events) for t in range(n)])
    over = np.maximum(facts.ego.speed - facts.speed_limit, 0)[:n]
    duration = facts.time[n - 1] - facts.time[0]
    comfort = comfort_series(facts)
    found = {
        "no_collision_at_fault": 0.0 if faults else 1.0,
        "drivable_area": float(np.all(facts.road_margin[:n] > -0.3)),
        "driving_direction": 1.0 if against < 2 else 0.5 if against < 6 else 0.0,
        "making_progress": float(ratio >= 0.2),
        "ttc_within_bound": float(np.all(times > 0.95)),
        "progress": ratio,
        "speed_limit": max(0.0, 1 - over.sum() * period / (2.23 * duration)),
        "comfort": float(all(np.all((x > BOUNDS[k][0]) & (x < BOUNDS[k][1])) for k, x in comfort.items())),
        "least_ttc": min(times.min(), 3.0),
    }
    gate = np.prod(
        [found[k] for k in ("no_collision_at_fault", "drivable_area", "driving_direction", "making_progress")]
    )
    weighted = [("ttc_within_bound", 5), ("progress", 5), ("speed_limit", 4), ("comfort", 2)]
    found["total"] = gate * sum(w * found[k] for k, w in weighted) / 16
    series = comfort | {"advance": advance, "ttc": np.minimum(times, 3.0), "overspeed": over}
    series["at_fault"] = np.array([float(any(step == t for step, _ in faults)) for t in range(n)])
    return found, series


COEFFICIENTS = {"pedestrians": 0.5, "vehicles": 0.6, "statics": 0.65, "red_lights": 0.7}


def carla(facts):
    n, counts = int(facts.alive.sum()), dict.fromkeys(COEFFICIENTS, 0)
    others = facts.others
    for v in range(others.valid.shape[1]):
        hits = [t for t in range(n) if touch(facts, t, v)]
        if not hits or facts.ego.speed[hits[0]] < 0.1:
            continue
        speeds = [others.speed[t, v] for t in range(n) if others.valid[t, v]]
        kind = others.kind[hits[0], v]
        name = "pedestrians" if kind == 1 else "statics" if kind == 0 and max(speeds) < 0.1 else "vehicles"
        counts[name] += 1
    counts["red_lights"] = int(facts.ran_red[:n].sum())
    total = wrong = 0.0
    for t in range(1, n):
        step = abs(facts.station[t] - facts.station[t - 1])
        off = facts.road_margin[t] + facts.ego.width[t] / 2 < -0.5 or facts.along[t] < -0.1
        total, wrong = total + step, wrong + step * off
    made = (facts.station[:n].max() - facts.station[0]) / (facts.goal - facts.station[0])
    found = {"completion": 1.0 if facts.reached else min(max(made, 0.0), 1.0), "outside": wrong / max(total, 1e-3)}
    found["penalty"] = np.prod([COEFFICIENTS[name] ** count for name, count in counts.items()])
    found["total"] = 100 * found["completion"] * (1 - found["outside"]) * found["penalty"]
    return found | counts


def commonroad(facts):
    n = int(facts.alive.sum())
    period = np.mean(np.diff(facts.time[:n]))
    speed = facts.ego.speed[:n]
    distances = []
    for t in range(n):
        road = facts.ego.heading[t] - facts.heading_error[t]
        along, left = np.array([np.cos(road), np.sin(road)]), np.array([-np.sin(road), np.cos(road)])
        away = [facts.others.position[t, v] - facts.ego.position[t] for v in np.flatnonzero(facts.others.valid[t])]
        ahead = [d @ along - facts.ego.width[t] / 2.5 for d in away if abs(d @ left) < 2.8 and d @ along > 0]
        distances.append(min([np.inf, *ahead]))
    acceleration = np.diff(speed) / period
    found = {
        "time": facts.time[n - 1] - facts.time[0],
        "velocity_offset": 0.0,
        "acceleration": simpson(acceleration**2, dx=period),
        "jerk": simpson((np.diff(acceleration) / period) ** 2, dx=period),
        "obstacles": simpson(np.exp(-0.2 * np.array(distances)), dx=period),
        "length": simpson(speed, dx=period),
    }
    return found | {"total": float(np.dot([10, 1, 0.1, 0.1, 0.1, 10], list(found.values())))}


def competition(facts, vehicle):
    n = int(facts.alive.sum())

    def times(wrong):
        return sum(bool(wrong[t]) and (t == 0 or not wrong[t - 1]) for t in range(n))

    violations = [
        sum(fault for _, _, fault in at_fault_events(facts, vehicle)),
        times(facts.road_margin < 0),
        int(facts.ran_red[:n].sum()),
        times(facts.ego.speed > facts.speed_limit + 1),
        times(facts.wrong_way),
    ]
    time = facts.time[n - 1] if facts.reached else facts.limit
    total = time + np.dot([60, 20, 30, 5, 10], violations)
    return {"total": total, "violations": violations, "time": time, "success": facts.reached and not any(violations)}
