"""Drives in chunks: what comes out does not depend on what else is in them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.drivers import IdmDriver, PdmDriver, Standstill
from urbanjax.evaluation import batch
from urbanjax.evaluation.batch import Job, Outcome, case_of, outcomes
from urbanjax.evaluation.facts import facts
from urbanjax.evaluation.missions import MISSIONS
from urbanjax.evaluation.verdict import Cause
from urbanjax.rollout import LoopParams, rollout
from urbanjax.types import ConfigError, as_arrays

LOOP = LoopParams(driver=IdmDriver())
JOBS = [Job(MISSIONS[name], seed) for name, seed in (("cut_in", 0), ("cut_in", 1), ("signal_left", 2), ("cut_in", 3))]
CHUNK = 4


@pytest.fixture(scope="module")
def found():
    return list(outcomes(LOOP, JOBS, chunk=CHUNK, logs=True))


def equal(one, other):
    assert one.job == other.job
    assert one.row.keys() == other.row.keys()
    for name, value in one.row.items():
        np.testing.assert_array_equal(value, other.row[name], err_msg=name)


def test_a_drive_is_the_same_in_any_company(found):
    turned = list(outcomes(LOOP, JOBS[::-1], chunk=CHUNK))[::-1]
    fewer = list(outcomes(LOOP, JOBS[1:], chunk=CHUNK))
    for k, one in enumerate(found):
        equal(one, turned[k])
        if k:
            equal(one, fewer[k - 1])


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
    idm = list(batch._stream(as_arrays(LOOP), enumerate(jobs), "idm", CHUNK, logs=True, whole=True))
    for loop, same in ((LOOP, True), (standing, False)):
        for (_, was), one in zip(idm, outcomes(loop, jobs, traffic="replay", chunk=CHUNK, logs=True), strict=True):
            v, n = was.log.traffic.valid.shape[1], round(float(one.row["duration_s"]) * 10)
            np.testing.assert_allclose(one.log.traffic.position[:n, v:], was.log.traffic.position[:n], atol=1e-2)
            assert not one.log.traffic.valid[:, :v].any()
            assert np.allclose(one.log.centre[:n], was.log.centre[:n], atol=0.05) == same
