"""The EPDMS once more: float64, NumPy, one window, step by step, from the published scorer alone."""

import numpy as np

from tests.evaluation.scores import oracle

WEIGHTS = {
    "ego_progress": 5,
    "time_to_collision_within_bound": 5,
    "lane_keeping": 2,
    "history_comfort": 2,
    "extended_comfort": 2,
}
GATES = (
    "no_at_fault_collisions",
    "drivable_area_compliance",
    "driving_direction_compliance",
    "traffic_light_compliance",
)


def _angle(window, t, later, v, vehicle):
    """Of the other's centre at a later step, off the heading and seen from the rear axle at t [rad]."""
    heading = window.ego.heading[t]
    forward = np.array([np.cos(heading), np.sin(heading)])
    rear = window.ego.position[t] - (vehicle.length / 2 - vehicle.rear_overhang) * forward
    away = window.others.position[later, v] - rear
    return np.arccos(np.clip(forward @ away / np.linalg.norm(away), -1, 1))


def collisions(window, n, vehicle):
    """Steps and others of collisions at fault; whoever collided without is ignored from then on."""
    found, ignored = [], set()
    for t in range(n):
        for v in range(window.others.valid.shape[1]):
            if v in ignored or not oracle.touch(window, t, v):
                continue
            if abs(window.ego.speed[t]) <= 0.05:
                fault = False
            elif abs(window.others.speed[t, v]) <= 0.05:
                fault = True
            elif _angle(window, t, t, v, vehicle) > np.deg2rad(150):
                fault = False
            elif oracle.intersect(oracle.ego_box(window, t)[[0, 3]], oracle.other_box(window, t, v)):
                fault = True
            else:
                fault = not window.in_one_lane[t]
            if fault:
                found.append((t, v))
            else:
                ignored.add(v)
    return found


def infractions(window, n, vehicle):
    """Steps in which a time to collision counts."""
    found, ignored, ego, others = [], set(), window.ego, window.others
    for t in range(n - 9):
        for step in (0, 3, 6, 9):
            forward = np.array([np.cos(ego.heading[t]), np.sin(ego.heading[t])])
            moved = abs(ego.speed[t]) * step * 0.1 * forward
            for v in range(others.valid.shape[1]):
                if v in ignored or not others.valid[t + step, v] or abs(ego.speed[t]) < 0.005:
                    continue
                if np.linalg.norm(others.position[t + step, v] - ego.position[t] - moved) > 12:
                    continue
                if not oracle.intersect(oracle.ego_box(window, t) + moved, oracle.other_box(window, t + step, v)):
                    continue
                off = _angle(window, t, t + step, v, vehicle)
                wide = (not window.in_one_lane[t]) or window.in_junction[t]
                if off < np.deg2rad(30) or (wide and not off > np.deg2rad(150)):
                    found.append(t)
                else:
                    ignored.add(v)
    return found


def against(window, n):
    moved = [0.0]
    for t in range(1, n):
        out = window.oncoming[t] or window.road_margin[t] + window.ego.width[t] / 2 < 0
        way = np.linalg.norm(window.ego.position[t] - window.ego.position[t - 1])
        moved.append(way if out and not window.in_junction[t] else 0.0)
    return np.array([sum(moved[max(0, t - 10) : t + 1]) for t in range(n)])


def lane_keeping(window, n):
    spell = 0
    for t in range(n):
        if window.in_junction[t]:
            continue
        spell = spell + 1 if abs(window.offset[t]) > 0.5 else 0
        if spell >= 20:
            return 0.0
    return 1.0


def comfort_series(window, n, before):
    h = int(before.alive.sum())
    period = np.mean(np.diff(window.time[:n]))

    def joined(take):
        return np.concatenate([take(before)[len(before.alive) - h :], take(window)[:n]])

    along = joined(lambda f: f.acceleration)
    across = joined(lambda f: f.ego.speed * f.yaw_rate)
    heading = np.unwrap(joined(lambda f: f.ego.heading))

    def jerk(values):
        return oracle.smoothed(oracle.smoothed(values, 8, 2), 15, 2, 1, period)

    return h, {
        "longitudinal": oracle.smoothed(along, 8, 2),
        "lateral": oracle.smoothed(across, 8, 2),
        "jerk": jerk(np.hypot(along, across)),
        "longitudinal_jerk": jerk(along),
        "yaw_rate": oracle.smoothed(heading, 5, 2, 1, period),
        "yaw_acceleration": oracle.smoothed(heading, 5, 3, 2, period),
    }


def way(window, n):
    return max(window.station[n - 1] - window.station[0], 0.0)


def gates(window, n, vehicle):
    worst = against(window, n).max()
    return {
        "no_at_fault_collisions": 0.0 if collisions(window, n, vehicle) else 1.0,
        "drivable_area_compliance": float(np.all(window.road_margin[:n] >= 0)),
        "driving_direction_compliance": 1.0 if worst < 2 else 0.5 if worst < 6 else 0.0,
        "traffic_light_compliance": float(not np.any(window.ran_red[1:n])),
    }


def epdms(window, vehicle, *, reference, before, extended=None):
    """The columns of the score and the series they are made of."""
    n = int(window.alive.sum())
    found = gates(window, n, vehicle)
    gate, made = np.prod(list(found.values())), way(window, n)
    most = max(made * gate, reference)
    h, comfort = comfort_series(window, n, before)
    near = infractions(window, n, vehicle)
    found |= {
        "ego_progress": min(made / most, 1.0) if most > 5 else 1.0,
        "time_to_collision_within_bound": 0.0 if near else 1.0,
        "lane_keeping": lane_keeping(window, n),
        "history_comfort": float(
            all(np.all((x > oracle.BOUNDS[k][0]) & (x < oracle.BOUNDS[k][1])) for k, x in comfort.items())
        ),
        "extended_comfort": 0.0 if extended is None else extended,
        "extended_comfort_defined": float(extended is not None),
    }
    weights = {k: w for k, w in WEIGHTS.items() if k != "extended_comfort" or extended is not None}
    found["total"] = gate * sum(w * found[k] for k, w in weights.items()) / sum(weights.values())
    found |= {f"gated_{k}": gate * found[k] for k in WEIGHTS} | {"gate": gate, "way": made, "reference": reference}
    series = {k: x[h:] for k, x in comfort.items()} | {"against": against(window, n)}
    series["deviation"] = np.abs(window.offset[:n])
    return found, series
