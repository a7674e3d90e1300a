"""Drives in chunks: what comes out does not depend on what else is in them."""

import dataclasses
from collections.abc import Iterator
from contextlib import contextmanager

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.drivers import IdmDriver, PdmDriver, Standstill
from urbanjax.evaluation import batch
from urbanjax.evaluation.batch import Job, Outcome, case_of, outcomes
from urbanjax.evaluation.facts import facts
from urbanjax.evaluation.missions import MISSIONS
from urbanjax.evaluation.parameter_sets import parameter_sets
from urbanjax.evaluation.verdict import Cause
from urbanjax.rollout import LoopParams, rollout
from urbanjax.sim.agents import TrafficParams
from urbanjax.sim.world import SimParams
from urbanjax.types import ConfigError, as_arrays
from urbanjax.vehicle.following import IDMParams

LOOP = LoopParams(driver=IdmDriver())
JOBS = [Job(MISSIONS[name], seed) for name, seed in (("cut_in", 0), ("cut_in", 1), ("signal_left", 2), ("cut_in", 3))]
CHUNK = 4
SETS = [LOOP, *(LoopParams(driver=IdmDriver(following=IDMParams(time_headway=headway))) for headway in (0.7, 2.5))]


@pytest.fixture(scope="module")
def found():
    return list(outcomes(LOOP, JOBS, chunk=CHUNK, logs=True))


def equal(one, other):
    assert one.job == other.job
    assert one.row.keys() == other.row.keys()
    for name, value in one.row.items():
        np.testing.assert_array_equal(value, other.row[name], err_msg=name)


def of_sets(jobs, numbers):
    return [dataclasses.replace(job, params=k) for job in jobs for k in numbers]


def equal_alone(one, alone):
    """The outcome of a drive of several sets, and of the same with its set alone."""
    row = dict(one.row)
    assert row.pop("params") == one.job.params
    equal(Outcome(dataclasses.replace(one.job, params=0), row), alone)


@contextmanager
def compilations() -> Iterator[list[str]]:
    heard: list[str] = []

    def count(event: str, duration: float, **told: object) -> None:
        heard.extend([str(told["fun_name"])] if event == "/jax/core/compile/backend_compile_duration" else [])

    jax.monitoring.register_event_duration_secs_listener(count)
    try:
        yield heard
    finally:
        jax.monitoring.unregister_event_duration_listener(count)


def test_a_drive_is_the_same_in_any_company(found):
    turned = list(outcomes(LOOP, JOBS[::-1], chunk=CHUNK))[::-1]
    fewer = list(outcomes(LOOP, JOBS[1:], chunk=CHUNK))
    for k, one in enumerate(found):
        equal(one, turned[k])
        if k:
            equal(one, fewer[k - 1])


def test_sets_share_the_program_and_each_drive_is_that_of_its_set_alone(found):
    """Three sets in every chunk of four; the program is the one that drove a single set before."""
    jobs = of_sets(JOBS, range(3))
    with compilations() as heard:
        mixed = list(outcomes(SETS, jobs, chunk=CHUNK))
        assert set(heard) <= {"jit(renewed)"}, "the first time that more is driven than there are places"
        heard.clear()
        alone = [list(outcomes(loop, JOBS, chunk=CHUNK)) for loop in SETS]
        assert not heard
    assert [one.job for one in mixed] == jobs
    for k, one in enumerate(mixed):
        equal_alone(one, alone[k % 3][k // 3])
    for one, plain in zip(found, alone[0], strict=True):
        equal(one, plain)
        assert "params" not in plain.row
    assert len({tuple(float(one.row["commonroad_total"]) for one in drives) for drives in alone}) == len(SETS)


@pytest.mark.parametrize(
    ("sets", "message"),
    [
        ([LOOP, LoopParams(driver=Standstill())], "set 1 differs from set 0 in 'driver'"),
        ([LOOP, LOOP, LOOP.replace(period=0.2)], "set 2 differs from set 0 in 'period', .* the same in all"),
        (
            [LOOP, LOOP.replace(sim=SimParams(traffic=TrafficParams(n_links=3)))],
            "set 1 differs from set 0 in 'sim\\.traffic\\.n_links'",
        ),
        (
            [LOOP, LOOP.replace(vehicle=LOOP.vehicle.replace(length=np.full(2, 4.7)))],
            "set 1 differs from set 0 in 'vehicle\\.length'",
        ),
        ([], "no parameter set"),
        ([LOOP] * 3, "no parameter set 3: give jobs a number from 0 to 2"),
    ],
)
def test_sets_that_no_program_holds_are_refused(sets, message):
    with pytest.raises(ConfigError, match=message):
        next(outcomes(sets, of_sets(JOBS, [0, 3])))


@pytest.mark.slow
def test_replayed_traffic_is_that_of_the_set():
    sets = [LOOP.replace(sim=SimParams(traffic=TrafficParams(idm=IDMParams(time_headway=t)))) for t in (1.0, 2.5)]
    mixed = list(outcomes(sets, of_sets(JOBS[:2], (1, 0)), traffic="replay", chunk=CHUNK))
    alone = [list(outcomes(loop, JOBS[:2], traffic="replay", chunk=CHUNK)) for loop in sets]
    for k, one in enumerate(mixed):
        equal_alone(one, alone[one.job.params][k // 2])
    asked = [
        batch.moment(*args, traffic="replay", time=3.2, chunk=CHUNK)
        for args in ((sets, mixed[0].job), (sets[1], JOBS[0]))
    ]
    jax.tree.map(np.testing.assert_array_equal, *asked)


@pytest.mark.slow
def test_it_is_the_closed_loop_until_the_drive_ends(found):
    one = found[0]
    case = jax.tree.map(jnp.asarray, case_of(LOOP, one.job, traffic="idm"))
    steps = 60
    log, _ = jax.jit(lambda loop, case: rollout(loop, case.course, case.lanes, case.start, steps))(
        as_arrays(LOOP), case
    )
    np.testing.assert_allclose(one.log.centre[:steps], log.centre, atol=1e-3)
    np.testing.assert_allclose(one.log.time[:steps], log.time, atol=1e-4)
    assert one.log.time.shape == (300,)
    assert np.all(np.diff(one.log.time) > 0.09)
    whole = facts(jax.tree.map(jnp.asarray, one.log), case, vehicle=LOOP.vehicle)
    assert bool(whole.reached) == bool(one.row["competition_reached"])
    assert float(whole.duration) == pytest.approx(float(one.row["duration_s"]), abs=1e-4)


@pytest.mark.slow
def test_with_the_epdms_the_rest_of_a_row_stays(found):
    more = list(outcomes(LOOP, JOBS, chunk=CHUNK, epdms=True))
    for one, other in zip(found, more, strict=True):
        added = {name for name in other.row if name.startswith("epdms_driven_")}
        assert other.row.keys() - added == one.row.keys()
        equal(one, Outcome(other.job, {name: other.row[name] for name in one.row}))
        assert added >= {"epdms_driven_total", "epdms_driven_gate", "epdms_driven_extended_comfort_defined"}
        assert np.isfinite([float(other.row[name]) for name in added]).all()
        segments = round(float(other.row["duration_s"]) * 10) / batch.SEGMENT
        assert int(other.row["epdms_driven_windows"]) == int(segments) + (segments % 1 >= 0.8)


@pytest.mark.slow
def test_the_reference_makes_the_way_of_the_reference():
    for one in outcomes(LoopParams(driver=PdmDriver()), JOBS, chunk=CHUNK, epdms=True):
        row = {name.removeprefix("epdms_driven_"): float(value) for name, value in one.row.items() if "epdms" in name}
        assert row["ego_progress"] == 1
        if row["gate"] == 1:
            assert row["way"] == pytest.approx(row["reference"], abs=1e-3)


def test_the_epdms_has_a_period_of_its_own():
    with pytest.raises(ConfigError, match="'period' is 0\\.2 s"):
        next(outcomes(LOOP.replace(period=0.2), JOBS, epdms=True))


def test_the_row_says_whether_and_why(found):
    for one in found:
        row = one.row
        violated = sum(
            int(row[f"competition_{name}"]) for name in ("at_fault", "off_road", "red_light", "speeding", "oncoming")
        )
        assert bool(row["success"]) == (bool(row["competition_reached"]) and violated == 0)
        assert (row["cause"] == Cause.NONE) == bool(row["success"])
        assert np.isnan(row["cause_time_s"]) == bool(row["success"])
        gates = np.prod(
            [
                row[f"nuplan_{name}"]
                for name in ("no_collision_at_fault", "drivable_area", "driving_direction", "making_progress")
            ]
        )
        parts = np.array([row[f"nuplan_{name}"] for name in ("ttc_within_bound", "progress", "speed_limit", "comfort")])
        assert row["nuplan_total"] == pytest.approx(gates * parts @ np.array([5, 5, 4, 2]) / 16, abs=1e-5)


def test_the_end_of_a_log_is_held(found):
    log = batch._padded([jax.tree.map(lambda x: x[:50], found[0].log)], 70, 0.1)
    assert log.time.shape == (70,)
    np.testing.assert_allclose(np.diff(log.time), 0.1, atol=1e-5)
    np.testing.assert_array_equal(log.centre[50:], np.broadcast_to(log.centre[49], (20, 2)))


def test_places_are_taken_again(found):
    """Twelve drives in four places, so that they begin at different times beside others that go on."""
    more = [*JOBS, *(Job(MISSIONS["cut_in"], seed) for seed in range(4, 8)), *JOBS]
    out = list(outcomes(LOOP, more, chunk=CHUNK))
    assert [one.job for one in out] == more
    for k, one in enumerate(found):
        equal(one, out[k])
        equal(one, out[k + 8])


@pytest.mark.slow
def test_replayed_traffic_moves_as_it_did_with_idm_in_the_egos_place():
    """With the same driver in that place all is as it was; with another one nobody minds."""
    jobs, standing = JOBS[:2], LOOP.replace(driver=Standstill())
    idm = list(batch._stream(parameter_sets(LOOP, traffic="idm"), enumerate(jobs), "idm", CHUNK, logs=True, whole=True))
    for loop, same in ((LOOP, True), (standing, False)):
        for (_, was), one in zip(idm, outcomes(loop, jobs, traffic="replay", chunk=CHUNK, logs=True), strict=True):
            v, n = was.log.traffic.valid.shape[1], round(float(one.row["duration_s"]) * 10)
            np.testing.assert_allclose(one.log.traffic.position[:n, v:], was.log.traffic.position[:n], atol=1e-2)
            assert not one.log.traffic.valid[:, :v].any()
            assert np.allclose(one.log.centre[:n], was.log.centre[:n], atol=0.05) == same
