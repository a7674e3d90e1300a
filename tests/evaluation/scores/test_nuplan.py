import jax
import numpy as np
import pytest

from tests.evaluation.scores import oracle
from tests.evaluation.scores.drives import VEHICLE, batch, clean_drive, edited, stacked
from urbanjax.evaluation.scores import nuplan

score = jax.jit(nuplan.score)
GATES = ("no_collision_at_fault", "drivable_area", "driving_direction", "making_progress")
WEIGHTED = {"ttc_within_bound": 5, "progress": 5, "speed_limit": 4, "comfort": 2}
COLUMNS = (*GATES, *WEIGHTED)


def compare(t, n):
    drives = batch(t, t, n)
    found, steps = jax.jit(jax.vmap(lambda f: (nuplan.score(f, VEHICLE), nuplan.series(f, VEHICLE))))(stacked(drives))
    rows, steps = [], jax.device_get(steps)
    for i, drive in enumerate(drives):
        wanted, series = oracle.nuplan(drive, VEHICLE)
        rows.append(wanted)
        for name, values in series.items():
            np.testing.assert_allclose(getattr(steps, name)[i][: len(values)], values, atol=1e-5, err_msg=f"{i} {name}")
    for name in rows[0]:
        wanted = np.array([row[name] for row in rows])
        tolerance = 1e-5 if name in ("progress", "speed_limit", "least_ttc", "total") else 0
        np.testing.assert_allclose(np.asarray(getattr(found, name)), wanted, rtol=0, atol=tolerance, err_msg=name)
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def test_as_the_definitions_have_it(x64):
    found = compare(60, 100)
    for name in COLUMNS:  # every outcome occurs
        assert found[name].min() < 0.5 < found[name].max(), name


@pytest.mark.slow
@pytest.mark.parametrize("t", [60, 100])
def test_as_the_definitions_have_it_often(x64, t):
    compare(t, 1000)


def columns(drive):
    found = score(drive, VEHICLE)
    return {name: float(getattr(found, name)) for name in COLUMNS} | {"total": float(found.total)}


CLEAN = clean_drive()
BRAKE = np.interp(np.arange(100), [0, 30, 50, 64, 90], [0, 0, -3.8, 2.2, 0])  # 4.3 m/s^3 for 1.4 s
NEAR = clean_drive(others=((12.0, 0.0, 0.0, 10.0),))
PLANTED = {
    "hit from behind": (clean_drive(others=((-8.0, 0.3, 0.0, 12.0),)), {}),
    "hit while standing": (
        clean_drive(others=((8.0, 0.0, np.pi, 3.0),)).replace(ego=CLEAN.ego.replace(speed=np.zeros(100))),
        {},
    ),
    "hit from the side within a lane": (clean_drive(others=((-1.5, 3.0, -0.2, 10.3),)), {}),
    "hit from the side between lanes": (
        clean_drive(others=((-1.5, 3.0, -0.2, 10.3),), in_one_lane=np.zeros(100, bool)),
        {"no_collision_at_fault": 0, "ttc_within_bound": 0},
    ),
    "hitting in front": (
        clean_drive(others=((20.0, 0.0, 0.0, 6.0),)),
        {"no_collision_at_fault": 0, "ttc_within_bound": 0},
    ),
    "a corner outside": (CLEAN.replace(road_margin=edited(CLEAN.road_margin, 40, -0.4)), {"drivable_area": 0}),
    "a corner just outside": (CLEAN.replace(road_margin=edited(CLEAN.road_margin, 40, -0.29)), {}),
    "1.9 m against": (CLEAN.replace(along=edited(CLEAN.along, slice(40, 60), -1.9 / 1.1)), {}),
    "3 m against": (CLEAN.replace(along=edited(CLEAN.along, slice(40, 60), -3 / 1.1)), {"driving_direction": 0.5}),
    "8 m against": (CLEAN.replace(along=edited(CLEAN.along, slice(40, 60), -8 / 1.1)), {"driving_direction": 0}),
    "half the way": (CLEAN.replace(goal=2 * CLEAN.station[-1]), {"progress": 0.5}),
    "no way": (CLEAN.replace(station=np.zeros(100)), {"progress": 2 / 98.5, "making_progress": 0}),
    "backwards": (CLEAN.replace(station=-CLEAN.station), {"progress": 0, "making_progress": 0}),
    "following closely": (NEAR, {}),
    "0.8 s from a collision": (
        NEAR.replace(others=NEAR.others.replace(speed=edited(NEAR.others.speed, (50, 0), 0.9))),
        {"ttc_within_bound": 0},
    ),
    "1.1 s from a collision": (
        NEAR.replace(others=NEAR.others.replace(speed=edited(NEAR.others.speed, (50, 0), 3.1))),
        {},
    ),
    "too fast by 1.115 m/s": (CLEAN.replace(speed_limit=np.full(100, 10 - 1.115)), {"speed_limit": 1 - 100 / 99 / 2}),
    "a jerk": (CLEAN.replace(acceleration=BRAKE), {"comfort": 0}),
    "a slower jerk": (CLEAN.replace(acceleration=0.9 * BRAKE), {}),
    "braking hard": (CLEAN.replace(acceleration=np.full(100, -4.1)), {"comfort": 0}),
    "turning fast": (CLEAN.replace(yaw_rate=np.full(100, 0.5)), {"comfort": 0}),
    "turning": (CLEAN.replace(yaw_rate=np.full(100, 0.48)), {}),
}


@pytest.mark.parametrize("name", PLANTED)
def test_a_planted_fault_moves_its_term_alone(name):
    drive, changed = PLANTED[name]
    found = columns(drive)
    for column in COLUMNS:
        np.testing.assert_allclose(found[column], changed.get(column, 1), atol=1e-4, err_msg=column)


def test_the_total_is_that_of_the_columns():
    found = jax.jit(jax.vmap(lambda f: nuplan.score(f, VEHICLE)))(stacked(batch(5, 60, 20)))
    gate = np.prod([getattr(found, name) for name in GATES], axis=0)
    np.testing.assert_allclose(found.gate, gate)
    for name, gated in zip(
        WEIGHTED, ("gated_ttc", "gated_progress", "gated_speed_limit", "gated_comfort"), strict=True
    ):
        np.testing.assert_allclose(getattr(found, gated), gate * getattr(found, name), rtol=1e-6)
    mean = sum(weight * np.asarray(getattr(found, name)) for name, weight in WEIGHTED.items()) / 16
    np.testing.assert_allclose(found.total, gate * mean, rtol=1e-6)


def test_a_short_drive_has_a_score():
    for n in (1, 2, 7):
        found = score(CLEAN.replace(alive=np.arange(100) < n, goal=np.asarray(0.5)), VEHICLE)
        assert float(found.total) == 1
    short = jax.tree.map(lambda x: x[:3] if np.ndim(x) else x, CLEAN).replace(goal=np.asarray(0.5))
    assert float(score(short, VEHICLE).total) == 1
