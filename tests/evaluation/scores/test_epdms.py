"""The EPDMS of driven windows."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.evaluation.scores import epdms_oracle as oracle
from tests.evaluation.scores.drives import VEHICLE, clean_drive, edited, random_drive, stacked, with_touches
from tests.evaluation.scores.epdms_oracle import GATES, WEIGHTS
from urbanjax.evaluation.scores import epdms
from urbanjax.evaluation.scores.epdms_windows import HISTORY, STEPS, driven, windows

COLUMNS = (*GATES, *(name for name in WEIGHTS if name != "extended_comfort"))
CONTINUOUS = ("ego_progress", "gated_ego_progress", "total", "way", "reference")


def cut(drive, first, count, alive):
    rows = slice(first, first + count)
    return jax.tree.map(lambda x: x[rows] if np.ndim(x) else x, drive).replace(alive=alive)


def random_window(rng):
    """A window, the steps before it (all of them or none), and the way of a reference."""
    drive = random_drive(rng, HISTORY + STEPS)
    drive = with_touches(drive.replace(alive=np.ones(HISTORY + STEPS, bool), ran_red=rng.random(56) < 0.01))
    n = STEPS if rng.random() < 0.7 else int(rng.integers(16, STEPS + 1))
    before = cut(drive, 0, HISTORY, np.full(HISTORY, rng.random() < 0.7))
    return cut(drive, HISTORY, STEPS, np.arange(STEPS) < n), before, rng.choice([3.0, 40.0]) * rng.random()


def judged(window, before, reference):
    return (
        epdms.score(window, VEHICLE, reference=reference, before=before),
        epdms.series(window, VEHICLE, before=before),
        epdms.gated_way(window, VEHICLE),
    )


def compare(seed, n):
    rng = np.random.default_rng(seed)
    drawn = [random_window(rng) for _ in range(n)]
    found, steps, ways = jax.device_get(jax.jit(jax.vmap(judged))(*stacked(drawn)))
    rows = []
    for i, (window, before, reference) in enumerate(drawn):
        wanted, series = oracle.epdms(window, VEHICLE, reference=reference, before=before)
        rows.append(wanted)
        for name, values in series.items():
            np.testing.assert_allclose(getattr(steps, name)[i][: len(values)], values, atol=1e-5, err_msg=f"{i} {name}")
        faults = {t for t, _ in oracle.collisions(window, len(values), VEHICLE)}
        near = set(oracle.infractions(window, len(values), VEHICLE))
        for name, begins in (("at_fault", faults), ("ttc_infraction", near)):
            degrees = np.flatnonzero(getattr(steps, name)[i])
            assert set(degrees) <= begins
            assert min(degrees, default=None) == min(begins, default=None), name
        np.testing.assert_allclose(ways[i], wanted["way"] * wanted["gate"], atol=1e-5)
    for name in rows[0]:
        wanted = np.array([row[name] for row in rows])
        np.testing.assert_allclose(
            getattr(found, name), wanted, rtol=0, atol=1e-5 if name in CONTINUOUS else 0, err_msg=name
        )
    assert set(rows[0]) == {spec.name for spec in dataclasses.fields(found)}
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def test_as_the_definition_has_it(x64):
    found = compare(0, 120)
    for name in COLUMNS:  # every outcome occurs
        assert found[name].min() < 0.5 < found[name].max(), name
    assert set(found["driving_direction_compliance"]) == {0, 0.5, 1}


@pytest.mark.slow
def test_as_the_definition_has_it_often(x64):
    compare(1, 2000)


CLEAN = clean_drive(t=STEPS)
CALM = clean_drive(t=HISTORY)
OFF = np.zeros(STEPS, bool)
NEAR = clean_drive(t=STEPS, others=((12.0, 0.0, 0.0, 10.0),))
SIDE = {"speed": 1.0, "others": ((-1.5, 2.4, -0.2, 1.03),)}
SCRAPED = clean_drive(t=STEPS, speed=1.0, others=((-1.0, 1.7, 0.0, 0.0),))
HIT = {"no_at_fault_collisions": 0, "time_to_collision_within_bound": 0}


def spell(n, first=5):
    return edited(CLEAN.offset, slice(first, first + n), -0.6)


def faster(step):
    return NEAR.replace(ego=NEAR.ego.replace(speed=edited(NEAR.ego.speed, step, 19.0)))


# What is planted: the window, what is otherwise than in a clean one, and what the columns are then.
PLANTED = {
    "nothing": (CLEAN, {}, {}),
    "hit slowly from behind": (clean_drive(t=STEPS, speed=1.0, others=((-6.0, 0.3, 0.0, 2.0),)), {"reference": 4}, {}),
    "hit from behind by who is then ahead of where the ego was": (
        clean_drive(t=STEPS, others=((-8.0, 0.3, 0.0, 12.0),)),
        {},
        {"time_to_collision_within_bound": 0},
    ),
    "scraping along who stands": (SCRAPED, {"reference": 4}, {"no_at_fault_collisions": 0}),
    "hit while standing": (
        clean_drive(t=STEPS, others=((8.0, 0.0, np.pi, 3.0),)).replace(ego=CLEAN.ego.replace(speed=np.zeros(STEPS))),
        {},
        {},
    ),
    "hit from the side within a lane": (clean_drive(t=STEPS, **SIDE), {"reference": 4}, {}),
    "hit from the side between lanes": (clean_drive(t=STEPS, **SIDE, in_one_lane=OFF), {"reference": 4}, HIT),
    "hitting in front": (clean_drive(t=STEPS, others=((12.0, 0.0, 0.0, 6.0),)), {}, HIT),
    "hitting who was touched before": (clean_drive(t=STEPS, others=((4.0, 0.0, 0.0, 9.9),)), {}, HIT),
    "a corner outside": (
        CLEAN.replace(road_margin=edited(CLEAN.road_margin, 40, -0.01)),
        {},
        {"drivable_area_compliance": 0},
    ),
    "a corner at the edge": (CLEAN.replace(road_margin=edited(CLEAN.road_margin, 40, 0)), {}, {}),
    "1 m against": (CLEAN.replace(oncoming=edited(OFF, slice(20, 21), True)), {}, {}),
    "3 m against": (
        CLEAN.replace(oncoming=edited(OFF, slice(20, 23), True)),
        {},
        {"driving_direction_compliance": 0.5},
    ),
    "11 m against": (CLEAN.replace(oncoming=edited(OFF, slice(20, 31), True)), {}, {"driving_direction_compliance": 0}),
    "3 m against in a junction": (
        CLEAN.replace(oncoming=edited(OFF, slice(20, 23), True), in_junction=edited(OFF, slice(20, 23), True)),
        {},
        {},
    ),
    "a red light": (CLEAN.replace(ran_red=edited(OFF, 20, True)), {}, {"traffic_light_compliance": 0}),
    "a red light before the window": (CLEAN.replace(ran_red=edited(OFF, 0, True)), {}, {}),
    "half the way": (CLEAN, {"reference": 80.0}, {"ego_progress": 0.5}),
    "more than the reference": (CLEAN, {"reference": 20.0}, {}),
    "no way where there is none": (CLEAN.replace(station=0.1 * CLEAN.station), {"reference": 4.9}, {}),
    "little way where there is more": (
        CLEAN.replace(station=0.1 * CLEAN.station),
        {"reference": 16.0},
        {"ego_progress": 0.25},
    ),
    "backwards": (CLEAN.replace(station=-CLEAN.station), {}, {"ego_progress": 0}),
    "following closely": (NEAR, {}, {}),
    "too fast towards the one ahead": (faster(10), {}, {"time_to_collision_within_bound": 0}),
    "too fast too late to be looked at": (faster(32), {}, {}),
    "2 s beside the line": (CLEAN.replace(offset=spell(20)), {}, {"lane_keeping": 0}),
    "1.9 s beside the line": (CLEAN.replace(offset=spell(19)), {}, {}),
    "2.5 s beside the line, 0.6 in a junction": (
        CLEAN.replace(offset=spell(25), in_junction=edited(OFF, slice(12, 18), True)),
        {},
        {},
    ),
    "2.6 s beside the line, 0.6 in a junction": (
        CLEAN.replace(offset=spell(26), in_junction=edited(OFF, slice(12, 18), True)),
        {},
        {"lane_keeping": 0},
    ),
    "braking hard": (CLEAN.replace(acceleration=np.full(STEPS, -4.1)), {}, {"history_comfort": 0}),
    "a jump from the steps before": (
        CLEAN,
        {"before": CALM.replace(acceleration=np.full(HISTORY, -4.0))},
        {"history_comfort": 0},
    ),
    "a jump from steps that there were not": (
        CLEAN,
        {"before": CALM.replace(acceleration=np.full(HISTORY, -4.0), alive=np.zeros(HISTORY, bool))},
        {},
    ),
}


def test_a_planted_fault_moves_its_term_alone():
    """All at once: padded to as many others as any has."""

    def padded(window):
        rows = window.others.valid.shape[1]
        wide = [(0, 0), (0, 2 - rows)]
        others = jax.tree.map(lambda x: np.pad(x, [*wide, *[(0, 0)] * (x.ndim - 2)]), window.others)
        return with_touches(window.replace(others=others))

    given = [
        (padded(window), how.get("before", CALM), np.asarray(how.get("reference", 40.0)))
        for window, how, _ in PLANTED.values()
    ]
    found, _, _ = jax.device_get(jax.jit(jax.vmap(judged))(*stacked(given)))
    touched = {name for name, (window, _, _) in zip(PLANTED, given, strict=True) if window.touches.any()}
    assert touched == {name for name in PLANTED if name.startswith(("hit", "scrap"))}
    for i, (name, (_, _, changed)) in enumerate(PLANTED.items()):
        for column in COLUMNS:
            assert getattr(found, column)[i] == pytest.approx(changed.get(column, 1), abs=1e-4), f"{name}: {column}"


def test_extended_comfort_counts_where_it_is_defined():
    @jax.jit
    def score(extended):
        return epdms.score(
            jax.tree.map(jnp.asarray, CLEAN), VEHICLE, reference=jnp.asarray(80.0), extended_comfort=extended
        )

    without = score(None)
    assert float(without.total) == pytest.approx((14 - 2.5) / 14)
    assert float(without.extended_comfort_defined) == 0
    for extended in (0.0, 1.0):
        found = score(jnp.asarray(extended))
        assert float(found.total) == pytest.approx((14 - 2.5 + 2 * extended) / 16)
        assert (float(found.extended_comfort), float(found.extended_comfort_defined)) == (extended, 1)


@pytest.mark.parametrize(("n", "every", "counted"), [(130, 40, 3), (130, 50, 2), (100, 40, 2), (25, 40, 1)])
def test_a_drive_is_the_mean_of_its_whole_windows(x64, n, every, counted):
    t = 131
    drive = random_drive(np.random.default_rng(4), t)
    drive = with_touches(drive.replace(alive=np.arange(t) < n))
    references, _ = windows(random_drive(np.random.default_rng(5), t).replace(alive=np.ones(t, bool)), every=every)
    found = jax.jit(driven, static_argnames="every")(drive, VEHICLE, references=references, every=every)
    assert int(found.windows) == counted
    rows = []
    for k in range(counted):
        first, count = k * every, min(STEPS, n - k * every)
        window = cut(drive, first, count, np.ones(count, bool))
        earlier = min(HISTORY, first)
        before = cut(drive, first - earlier, earlier, np.ones(earlier, bool))
        theirs = jax.tree.map(lambda x, k=k: np.asarray(x[k]), references)
        its = {"n": count, "window": theirs}
        reference = oracle.way(**its) * np.prod(list(oracle.gates(**its, vehicle=VEHICLE).values()))
        rows.append(oracle.epdms(window, VEHICLE, reference=reference, before=before)[0])
    for name in rows[0]:
        mean = np.mean([row[name] for row in rows])
        np.testing.assert_allclose(getattr(found.mean, name), mean, atol=1e-5, err_msg=name)


def test_a_log_shorter_than_a_window_has_a_score():
    short = clean_drive(t=12)
    references, _ = windows(clean_drive(t=STEPS))
    found = jax.jit(driven)(short, VEHICLE, references=references)
    assert int(found.windows) == 1
    assert float(found.mean.total) == 1
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(found))
