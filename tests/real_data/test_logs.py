"""The logs of the data folder: what they hold, what is wrong with them, and the frame of the Sakhir laps."""

import numpy as np
import pytest

from tests.io.logs.formats import F1, OPENACC, form
from urbanjax.io import logs
from urbanjax.io.logs import LogError
from urbanjax.io.logs.align import LogAlignParams, align
from urbanjax.io.logs.quality import coarseness, quality
from urbanjax.io.logs.resample import by_length, by_time
from urbanjax.io.logs.sampling import raw
from urbanjax.io.maps import racetrack

pytestmark = pytest.mark.real_data


@pytest.fixture(scope="module")
def traffic(data_dir):
    path = data_dir / "traffic"
    if not (path / "f1_sakhir").is_dir() or not (path / "openacc").is_dir():
        pytest.skip(f"no logs at {path}")
    return path


@pytest.fixture(scope="module")
def laps(traffic):
    return logs.read(traffic / "f1_sakhir" / "*" / "*_tel.json", form(F1))


@pytest.fixture(scope="module")
def platoons(traffic):
    return logs.read(traffic / "openacc" / "*" / "*.csv", form(OPENACC))


@pytest.fixture(scope="module")
def line(traffic):
    return racetrack.parse(traffic / "f1_sakhir" / "reference_line" / "tracks" / "Sakhir.csv")


def test_eight_drivers_have_three_laps_each_in_stated_units(laps):
    assert len(laps) == 24
    assert {log.team for log in laps} == {"ALB", "ANT", "BOT", "GAS", "HAM", "LEC", "NOR", "VER"}
    for log in laps:
        if log.team in ("BOT", "GAS"):  # both without a speed
            assert log.report.notes == ("the stated speed is 0 throughout",)
        else:
            assert log.report.speed_ratio == pytest.approx(1.0, abs=0.02)


def test_wrong_units_of_a_lap_are_noticed(traffic):
    lap = traffic / "f1_sakhir" / "HAM" / "24_tel.json"
    with pytest.raises(LogError, match=r"units\.position=dm"):
        logs.read(lap, form(F1, units={"position": "m", "speed": "km/h"}))
    with pytest.raises(LogError, match=r"units\.speed=km/h"):
        logs.read(lap, form(F1, units={"position": "dm", "speed": "mph"}))


def test_bottas_is_frozen_and_half_of_all_other_samples_are_interpolated(laps):
    for log in laps:
        q = quality(log)
        assert q.frozen == (log.team == "BOT")
        if not q.frozen:
            assert q.resolution == pytest.approx(0.1)
            assert 0.45 < q.interpolated_share < 0.55
            measured = log.take(raw(log)).position / 0.1
            np.testing.assert_allclose(measured, np.round(measured), atol=1e-6)
            assert 5300 < q.length < 5450


def test_gasly_is_coarser_than_all_others(laps):
    moving = [log for log in laps if log.team != "BOT"]
    ratio = coarseness([quality(log) for log in moving])
    theirs = [r for r, log in zip(ratio, moving, strict=True) if log.team == "GAS"]
    others = [r for r, log in zip(ratio, moving, strict=True) if log.team != "GAS"]
    assert min(theirs) > max(others)
    assert np.median(theirs) > 1.6 * np.median(others)


def test_all_drivers_share_a_frame_that_the_reference_line_gives(laps, line):
    teams = {team: [log.take(raw(log)).position for log in laps if log.team == team] for team in ["ALB", "HAM", "VER"]}
    params = LogAlignParams(reflection="either", starts=8)
    together = align(
        [path for paths in teams.values() for path in paths], line.position, closed=line.closed, params=params
    )
    assert not together.frame.reflected
    assert not together.ambiguous
    assert together.rms < 3.0
    assert together.median < 2.5
    assert together.p95 < 6.5  # a racing line uses all of 12 m to 16 m of width
    assert together.second_rms > 10 * together.rms
    assert together.coverage == 1.0
    for paths in teams.values():
        alone = align(paths, line.position, closed=line.closed).frame
        for path in paths:
            off = np.linalg.norm(alone.apply(path) - together.frame.apply(path), axis=-1)
            assert off.max() < 0.6


def test_a_part_of_a_lap_finds_the_same_frame(laps, line):
    path = next(log.take(raw(log)).position for log in laps if log.team == "HAM")
    whole = align(path, line.position, closed=line.closed).frame
    part = align(path[80:260], line.position, closed=line.closed)
    assert np.linalg.norm(part.frame.apply(path) - whole.apply(path), axis=-1).max() < 8.0
    assert not part.ambiguous


def test_vehicles_are_those_of_the_header_that_have_columns(platoons):
    runs = {run: [log.vehicle for log in platoons if log.run == run] for run in {log.run for log in platoons}}
    assert {run: len(names) for run, names in runs.items()} == {
        "handling_part38": 7,
        "handling_part40": 7,
        "dynamic_part22": 9,
        "handling_part14": 10,
    }
    assert runs["dynamic_part22"][:2] == ["SMART_TARGET", "MAZDA_3"]
    assert runs["handling_part14"][0] == "MAZDA_3"
    for log in platoons:
        assert log.report.speed_ratio == pytest.approx(1.0, abs=0.01)
        assert log.report.dropped == log.report.absent


def test_one_vehicle_has_tied_positions_while_it_moves(platoons):
    found = {(log.run, log.vehicle): quality(log) for log in platoons}
    tied = {key: q for key, q in found.items() if q.tied}
    assert list(tied) == [("handling_part40", "BMW_I3")]
    (q,) = tied.values()
    # 273 samples at 60 places: 213 repeat the one before, of which 153 repeat a repeat.
    assert (q.tied, q.places, q.repeated, q.repeated - q.places) == (273, 60, 213, 153)
    assert q.repeated_moving == 65


def test_platoons_share_a_clock_and_gaps_stay_gaps(platoons):
    run = [log for log in platoons if log.run == "handling_part40"]
    found = [by_time(log, 0.1, longest_gap=0.15) for log in run]
    for log, even in zip(run, found, strict=True):
        assert even.log.n == log.n - even.single
        assert even.gaps == even.piece.max() + even.single
    stuck = next(even for log, even in zip(run, found, strict=True) if log.vehicle == "BMW_I3")
    assert stuck.gaps == 5


def test_a_lap_at_even_stations_keeps_its_length(laps):
    log = next(log for log in laps if log.team == "LEC")
    found = by_length(log, 5.0, longest_gap=1.5, raw_only=True)
    assert found.interpolated == pytest.approx(log.n / 2, rel=0.05)
    assert found.piece.max() == 0
    step = np.linalg.norm(np.diff(found.log.position, axis=0), axis=-1)
    assert np.quantile(step, 0.05) > 4.8
    assert step.max() <= 5.0 + 1e-6
    assert 5.0 * found.log.n == pytest.approx(5350, rel=0.01)
