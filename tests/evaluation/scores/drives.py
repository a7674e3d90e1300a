"""Drives as `Facts`: random ones, and a clean one into which a single fault is planted."""

import jax
import numpy as np

from tests.evaluation.scores import oracle
from urbanjax.evaluation.facts import Facts
from urbanjax.types import Objects
from urbanjax.vehicle.params import VehicleParams

VEHICLE = VehicleParams()
PERIOD = 0.1


def with_touches(facts):
    """The same with touches as the boxes have them."""
    touches = np.zeros(facts.others.valid.shape, bool)
    for t in np.flatnonzero(facts.alive):
        for v in range(touches.shape[1]):
            touches[t, v] = oracle.touch(facts, t, v)
    first = touches & (np.cumsum(touches, axis=0) == 1)
    return facts.replace(touches=touches, first_touch=first)


def wander(rng, t, scale, pace=10):
    """A smooth random curve through a knot every `pace` steps."""
    knots = rng.normal(scale=scale, size=t // pace + 2)
    return np.interp(np.arange(t), np.arange(knots.size) * pace, knots)


def spells(rng, t, chance):
    """True in spells of ten steps."""
    return np.repeat(rng.random(t // 10 + 1) < chance, 10)[:t]


def path(start, heading, speed):
    step = speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1) * PERIOD
    return start + np.concatenate([np.zeros((1, 2)), np.cumsum(step, axis=0)[:-1]])


def random_drive(rng, t, v=4):
    """Any drive of t steps: what its fields say need not fit together, but for the touches."""
    n = t if rng.random() < 0.4 else int(rng.integers(15, t + 1))
    time = np.arange(t) * PERIOD
    calm = rng.choice([0.2, 1.0, 2.0], p=[0.6, 0.2, 0.2])
    speed = np.maximum(rng.uniform(-1, 12) + wander(rng, t, 1.5), 0)
    heading = rng.uniform(-np.pi, np.pi) + wander(rng, t, 0.1 * calm, pace=20)
    position = path(rng.uniform(-50, 50, 2), heading, speed)
    station = 30 + np.cumsum(speed * PERIOD) * rng.choice([1.0, 0.1, -0.2], p=[0.8, 0.1, 0.1])
    there = rng.random(v) < 0.6
    others_heading = heading[:1] + np.where(rng.random(v) < 0.5, 0, rng.uniform(-np.pi, np.pi, v))
    others_heading = others_heading + np.stack([wander(rng, t, 0.05) for _ in range(v)], axis=1)
    others_speed = np.stack([np.maximum(rng.uniform(-4, 10) + wander(rng, t, 1.0), 0) for _ in range(v)], axis=1)
    meeting = rng.integers(0, t, v)
    others_position = np.stack([path(np.zeros(2), others_heading[:, i], others_speed[:, i]) for i in range(v)], axis=1)
    near = rng.uniform(2, 12, v)[:, None] * (lambda a: np.stack([np.cos(a), np.sin(a)], -1))(
        rng.uniform(0, 2 * np.pi, v)
    )
    others_position += (position[meeting] + near - others_position[meeting, np.arange(v)])[None]
    facts = Facts(
        time=time,
        alive=np.arange(t) < n,
        station=station,
        offset=wander(rng, t, 1.0),
        heading_error=wander(rng, t, 0.2),
        along=speed * np.where(spells(rng, t, rng.choice([0.0, 0.1])), -1, 1),
        speed_limit=rng.choice([8.0, 14.0]) + wander(rng, t, 0.3),
        yaw_rate=wander(rng, t, 0.1 * calm),
        acceleration=wander(rng, t, calm),
        oncoming=np.zeros(t, bool),
        wrong_way=spells(rng, t, 0.1),
        in_one_lane=spells(rng, t, 0.7),
        in_junction=spells(rng, t, 0.2),
        lane_offset=wander(rng, t, 0.4),
        road_margin=0.6 + wander(rng, t, rng.choice([0.1, 0.6], p=[0.8, 0.2])),
        ran_red=(rng.random(t) < 0.01) & (np.arange(t) < n),
        ego=Objects(
            position,
            np.mod(heading + np.pi, 2 * np.pi) - np.pi,
            speed,
            np.full(t, VEHICLE.length),
            np.full(t, VEHICLE.width),
            np.ones(t, bool),
            np.zeros(t, np.int32),
        ),
        others=Objects(
            others_position,
            others_heading,
            others_speed,
            np.tile(rng.uniform(0.5, 6, v), (t, 1)),
            np.tile(rng.uniform(0.5, 2.2, v), (t, 1)),
            np.stack([spells(rng, t, 0.9) for _ in range(v)], axis=1) & there,
            np.tile(rng.integers(0, 3, v), (t, 1)).astype(np.int32),
        ),
        touches=np.zeros((t, v), bool),
        first_touch=np.zeros((t, v), bool),
        goal=np.asarray(30 + rng.uniform(0.5, 1.5) * t * PERIOD * 6),
        limit=np.asarray(t * PERIOD),
        reached=np.asarray(rng.random() < 0.5),
    )
    return with_touches(facts.replace(oncoming=facts.along < 0))


def clean_drive(t=100, others=((200.0, 0.0, 0.0, 10.0), (0.0, 40.0, 0.0, 10.0)), speed=10.0, **fields):
    """A drive along x at constant speed, past others given as (x, y, heading, speed), that loses nothing."""
    time, zero = np.arange(t) * PERIOD, np.zeros(t)
    x = speed * time
    rows = np.tile(np.asarray(others, float), (t, 1, 1))
    moved = rows[..., 3:] * time[:, None, None] * np.stack([np.cos(rows[..., 2]), np.sin(rows[..., 2])], axis=-1)
    v = rows.shape[1]
    facts = Facts(
        time=time,
        alive=np.ones(t, bool),
        station=x.copy(),
        offset=zero,
        heading_error=zero,
        along=zero + speed,
        speed_limit=zero + 13.0,
        yaw_rate=zero,
        acceleration=zero,
        oncoming=np.zeros(t, bool),
        wrong_way=np.zeros(t, bool),
        in_one_lane=np.ones(t, bool),
        in_junction=np.zeros(t, bool),
        lane_offset=zero,
        road_margin=zero + 0.8,
        ran_red=np.zeros(t, bool),
        ego=Objects(
            np.stack([x, zero], axis=-1),
            zero,
            zero + speed,
            zero + VEHICLE.length,
            zero + VEHICLE.width,
            np.ones(t, bool),
            np.zeros(t, np.int32),
        ),
        others=Objects(
            rows[..., :2] + moved,
            rows[..., 2],
            rows[..., 3],
            np.full((t, v), VEHICLE.length),
            np.full((t, v), VEHICLE.width),
            np.ones((t, v), bool),
            np.zeros((t, v), np.int32),
        ),
        touches=np.zeros((t, v), bool),
        first_touch=np.zeros((t, v), bool),
        goal=np.asarray(x[-1] - 0.5),
        limit=np.asarray(60.0),
        reached=np.asarray(True),
    )
    return with_touches(facts.replace(**fields))


def stacked(drives):
    return jax.tree.map(lambda *x: np.stack(x), *drives)


def batch(seed, t, n):
    rng = np.random.default_rng(seed)
    return [random_drive(rng, t) for _ in range(n)]


def busy_drive():
    """A drive that is close to all of its thresholds, but loses nothing for good."""
    rng = np.random.default_rng(3)
    drive = clean_drive(t=40, others=((9.0, 0.2, 0.05, 8.5), (-9.0, 1.0, 0.1, 10.5), (6.0, 3.2, 0.02, 10.0)))
    noise = {
        name: getattr(drive, name) + rng.normal(scale=0.2, size=40)
        for name in ("along", "speed_limit", "yaw_rate", "acceleration", "road_margin")
    }
    ego = drive.ego.replace(heading=0.1 * np.sin(np.arange(40) / 6), speed=10 + rng.normal(scale=0.1, size=40))
    return drive.replace(ego=ego, goal=np.asarray(60.0), speed_limit=noise.pop("speed_limit") - 3, **noise)


def edited(values, where, value):
    """A copy of values with others in some places."""
    values = np.array(values)
    values[where] = value
    return values
