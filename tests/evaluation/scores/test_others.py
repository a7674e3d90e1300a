"""The scores of CARLA, CommonRoad and the qualification."""

import jax
import numpy as np
import pytest

from tests.evaluation.scores import oracle
from tests.evaluation.scores.drives import VEHICLE, batch, clean_drive, edited, stacked
from urbanjax.evaluation.scores import carla, commonroad, competition
from urbanjax.evaluation.scores.competition import Violation

CLEAN = clean_drive()
SCORES = {
    "carla": (carla.score, oracle.carla),
    "commonroad": (commonroad.cost, oracle.commonroad),
    "competition": (lambda f: competition.score(f, VEHICLE), lambda f: oracle.competition(f, VEHICLE)),
}
driving, price, qualified = (jax.jit(ours) for ours, _ in SCORES.values())


def compare(name, t, n):
    ours, theirs = SCORES[name]
    drives = batch(t + 1, t, n)
    found = jax.jit(jax.vmap(ours))(stacked(drives))
    wanted = [theirs(drive) for drive in drives]
    for column in wanted[0]:
        values = np.array([row[column] for row in wanted])
        tolerance = 1e-5 if values.dtype.kind == "f" else 0
        np.testing.assert_allclose(
            np.asarray(getattr(found, column)), values, rtol=1e-9, atol=tolerance, err_msg=column
        )


@pytest.mark.parametrize("name", SCORES)
def test_as_the_definitions_have_it(x64, name):
    compare(name, 60, 100)


@pytest.mark.slow
@pytest.mark.parametrize("t", [60, 100])
@pytest.mark.parametrize("name", SCORES)
def test_as_the_definitions_have_it_often(x64, name, t):
    compare(name, t, 1000)


def hit(speed, kind):
    drive = clean_drive(others=((30.0, 0.0, 0.0, speed),))
    return drive.replace(others=drive.others.replace(kind=np.full((100, 1), kind, np.int32)))


RED = edited(np.zeros(100, bool), [20, 60], True)
INFRACTIONS = {
    "none": (CLEAN, {}),
    "a pedestrian": (hit(2.0, 1), {"pedestrians": 1, "penalty": 0.5}),
    "a standing pedestrian": (hit(0.0, 1), {"pedestrians": 1, "penalty": 0.5}),
    "a cyclist": (hit(2.0, 2), {"vehicles": 1, "penalty": 0.6}),
    "a vehicle": (hit(2.0, 0), {"vehicles": 1, "penalty": 0.6}),
    "a static object": (hit(0.0, 0), {"statics": 1, "penalty": 0.65}),
    "from behind": (clean_drive(others=((-8.0, 0.3, 0.0, 12.0),)), {"vehicles": 1, "penalty": 0.6}),
    "two red lights": (CLEAN.replace(ran_red=RED), {"red_lights": 2, "penalty": 0.49}),
    "half the way": (CLEAN.replace(goal=2 * CLEAN.station[-1], reached=np.asarray(False)), {"completion": 0.5}),
    "off the road": (CLEAN.replace(road_margin=edited(CLEAN.road_margin, slice(1, 34), -1.5)), {"outside": 1 / 3}),
    "a wheel off": (CLEAN.replace(road_margin=edited(CLEAN.road_margin, slice(1, 34), -1.4)), {}),
    "wrong lane": (CLEAN.replace(along=edited(CLEAN.along, slice(1, 34), -5.0)), {"outside": 1 / 3}),
}


@pytest.mark.parametrize("name", INFRACTIONS)
def test_an_infraction_costs_its_coefficient(name):
    drive, changed = INFRACTIONS[name]
    wanted = dict.fromkeys(("pedestrians", "vehicles", "statics", "red_lights", "outside"), 0)
    wanted |= {"completion": 1, "penalty": 1} | changed
    found = driving(drive)
    for column, value in wanted.items():
        np.testing.assert_allclose(getattr(found, column), value, atol=1e-5, err_msg=column)
    total = 100 * wanted["completion"] * (1 - wanted["outside"]) * wanted["penalty"]
    np.testing.assert_allclose(found.total, total, rtol=1e-5)


VIOLATIONS = {
    "none": (CLEAN, {}),
    "from behind": (clean_drive(others=((-8.0, 0.3, 0.0, 12.0),)), {}),
    "in front": (hit(2.0, 0), {Violation.AT_FAULT: 1}),
    "off the road twice": (
        CLEAN.replace(road_margin=edited(CLEAN.road_margin, [10, 11, 12, 50], -0.1)),
        {Violation.OFF_ROAD: 2},
    ),
    "two red lights": (CLEAN.replace(ran_red=RED), {Violation.RED_LIGHT: 2}),
    "too fast": (CLEAN.replace(speed_limit=edited(CLEAN.speed_limit, slice(30, 50), 8.9)), {Violation.SPEEDING: 1}),
    "hardly too fast": (CLEAN.replace(speed_limit=edited(CLEAN.speed_limit, slice(30, 50), 9.1)), {}),
    "oncoming": (CLEAN.replace(wrong_way=edited(CLEAN.wrong_way, slice(1, 34), True)), {Violation.ONCOMING: 1}),
}
PENALTIES = {
    Violation.AT_FAULT: 60,
    Violation.OFF_ROAD: 20,
    Violation.RED_LIGHT: 30,
    Violation.SPEEDING: 5,
    Violation.ONCOMING: 10,
}


@pytest.mark.parametrize("name", VIOLATIONS)
def test_a_violation_counts_alone(name):
    drive, wanted = VIOLATIONS[name]
    found = qualified(drive)
    assert {one: int(n) for one, n in zip(Violation, found.violations, strict=True) if n} == wanted
    assert bool(found.success) == (not wanted)
    assert bool(found.reached)
    np.testing.assert_allclose(found.time, 9.9, rtol=1e-5)
    np.testing.assert_allclose(found.total, 9.9 + sum(PENALTIES[one] * n for one, n in wanted.items()), rtol=1e-5)


def test_a_goal_not_reached_costs_the_limit():
    found = qualified(CLEAN.replace(reached=np.asarray(False)))
    assert not found.success
    assert float(found.time) == float(found.total) == 60


def test_known_costs():
    found = price(clean_drive(others=((20.0, 0.0, 0.0, 10.0),)))
    np.testing.assert_allclose([found.time, found.length], [9.9, 99.0], rtol=1e-5)
    assert float(found.acceleration) == float(found.jerk) == float(found.velocity_offset) == 0
    np.testing.assert_allclose(found.obstacles, 9.9 * np.exp(-0.2 * (20 - VEHICLE.width / 2.5)), rtol=1e-5)
    parts = 10 * found.time + 0.1 * found.obstacles + 10 * found.length
    np.testing.assert_allclose(found.total, parts, rtol=1e-6)
    quick = price(CLEAN.replace(ego=CLEAN.ego.replace(speed=10 + 2 * np.arange(100) * 0.1)))
    np.testing.assert_allclose(quick.acceleration, 4 * 9.8, rtol=1e-4)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_a_short_drive_has_scores(n):
    drive = CLEAN.replace(alive=np.arange(100) < n)
    for found in (driving(drive), price(drive), qualified(drive)):
        assert np.isfinite(float(found.total))
    np.testing.assert_allclose(price(drive).length, n - 1, rtol=1e-5)
