"""What is said of a drive: what it failed by first, when, and the columns of every score."""

import dataclasses

import jax
import numpy as np
import pytest

from tests.evaluation.scores.drives import VEHICLE, clean_drive, edited, stacked
from urbanjax.evaluation.scores import carla, commonroad, competition, nuplan
from urbanjax.evaluation.scores.competition import Violation
from urbanjax.evaluation.verdict import Cause, judge

STEPS = 100
CLEAN = clean_drive()
NOT_THERE = {"goal": np.asarray(200.0), "reached": np.asarray(False)}
OFF = np.zeros(STEPS, bool)


def meeting(speed, **fields):
    """Somebody 30 m ahead, touched in step 26 if it stands, and somebody far off."""
    return clean_drive(others=((30.0, 0.0, 0.0, speed), (0.0, 40.0, 0.0, 10.0)), **fields)


def standing(last):
    """The ego stands in the last steps."""
    return CLEAN.replace(ego=CLEAN.ego.replace(speed=edited(CLEAN.ego.speed, slice(STEPS - last, None), 0.1)))


RED, WRONG = edited(OFF, 40, True), edited(OFF, slice(50, 60), True)
OUTSIDE = edited(CLEAN.road_margin, slice(45, 50), -0.1)
SLOW = edited(CLEAN.speed_limit, slice(30, 50), 8.9)
# The drive, what it failed by, and when [s].
DRIVES = {
    "nothing": (CLEAN, Cause.NONE, np.nan),
    "hit standing": (meeting(0.0), Cause.HIT_STANDING, 2.6),
    "hit moving": (meeting(5.0), Cause.HIT_MOVING, 5.1),
    "left the road": (CLEAN.replace(road_margin=OUTSIDE), Cause.LEFT_ROAD, 4.5),
    "ran red": (CLEAN.replace(ran_red=RED), Cause.RAN_RED, 4.0),
    "wrong way": (CLEAN.replace(wrong_way=WRONG), Cause.WRONG_WAY, 5.0),
    "speeding": (CLEAN.replace(speed_limit=SLOW), Cause.SPEEDING, 3.0),
    "the first of several": (meeting(5.0, ran_red=RED, road_margin=OUTSIDE), Cause.RAN_RED, 4.0),
    "stood": (standing(31).replace(**NOT_THERE), Cause.STOOD, 9.9),
    "stood for less than 3 s": (standing(29).replace(**NOT_THERE), Cause.LATE, 9.9),
    "late": (CLEAN.replace(**NOT_THERE), Cause.LATE, 9.9),
    "after its end": (CLEAN.replace(alive=np.arange(STEPS) < 40, wrong_way=WRONG), Cause.NONE, np.nan),
}
PARTS = {
    "nuplan": nuplan.NuplanScore,
    "carla": carla.CarlaScore,
    "commonroad": commonroad.CommonRoadCost,
    "competition": competition.CompetitionScore,
}


@pytest.fixture(scope="module")
def rows():
    """Columns and the scores themselves, by drive."""

    def both(drive):
        apart = {
            "nuplan": nuplan.score(drive, VEHICLE),
            "carla": carla.score(drive),
            "commonroad": commonroad.cost(drive),
            "competition": competition.score(drive, VEHICLE),
        }
        return judge(drive, VEHICLE), apart

    found = jax.device_get(jax.jit(jax.vmap(both))(stacked([drive for drive, *_ in DRIVES.values()])))
    return {name: jax.tree.map(lambda x, i=i: x[i], found) for i, name in enumerate(DRIVES)}


@pytest.mark.parametrize("name", DRIVES)
def test_a_drive_is_told_by_its_first_violation(rows, name):
    row, _ = rows[name]
    drive, cause, when = DRIVES[name]
    assert Cause(int(row["cause"])) == cause
    assert row["success"] == (cause == Cause.NONE)
    np.testing.assert_allclose(row["cause_time_s"], when, rtol=1e-5)
    n = int(drive.alive.sum())
    np.testing.assert_allclose(row["duration_s"], 0.1 * (n - 1), rtol=1e-5)
    np.testing.assert_allclose(row["way_m"], drive.station[n - 1], rtol=1e-5)


def test_all_parts_of_all_scores_are_columns(rows):
    names = {f"{score}_{spec.name}" for score, kind in PARTS.items() for spec in dataclasses.fields(kind)}
    names |= {f"competition_{one.name.lower()}" for one in Violation}
    more = {"success", "cause", "cause_time_s", "way_m", "duration_s"}
    for row, apart in rows.values():
        assert row.keys() == names - {"competition_violations"} | more
        for score, parts in apart.items():
            for spec in dataclasses.fields(parts):
                values = np.atleast_1d(getattr(parts, spec.name))
                columns = [one.name.lower() for one in Violation] if spec.name == "violations" else [spec.name]
                np.testing.assert_array_equal([row[f"{score}_{name}"] for name in columns], values)


def test_the_scores_of_a_collision(rows):
    row, _ = rows["hit moving"]
    assert (row["nuplan_no_collision_at_fault"], row["nuplan_total"]) == (0, 0)
    np.testing.assert_allclose([row["carla_total"], row["competition_total"]], [60.0, 69.9], rtol=1e-5)
    np.testing.assert_allclose(row["commonroad_length"], 99.0, rtol=1e-5)
    assert (row["carla_vehicles"], row["competition_at_fault"]) == (1, 1)


def test_a_cause_has_words():
    assert [one.label for one in (Cause.NONE, Cause.HIT_MOVING, Cause.LATE)] == ["success", "hit moving", "late"]
