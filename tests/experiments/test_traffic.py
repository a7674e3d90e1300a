"""Traffic analysis of any logs: teams on a made-up course, platoons, an offset frame."""

import json
import math

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest

from tests.experiments import drives
from tests.experiments.drives import BASE, COLUMNS, LAPS, LENGTH, OFFSET, SPEED, WIDE, run

PAIRS = [(a, b) for a in ("blue", "green", "red") for b in ("blue", "green", "red") if a != b]
TEAMS = {"red": drives.laps(1), "blue": drives.laps(2), "green": drives.laps(3, left=3.0)}


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    root = tmp_path_factory.mktemp("traffic")
    drives.line(root)
    for name, drive in TEAMS.items():
        drives.team(root / "teams", name, drive)
    drives.platoon(root / "road", "one", (1.0, 1.4, 2.0))
    return root


@pytest.fixture(scope="module")
def compared(home):
    done = run(home, "files=[teams/*/*.csv]", *LAPS)
    assert done.code == 0, done.err
    return done


@pytest.fixture(scope="module")
def followed(home):
    done = run(home, "files=[road/one.csv]", *WIDE)
    assert done.code == 0, done.err
    return done


@pytest.fixture(scope="module")
def explained(home):
    done = run(home, *OFFSET)
    assert done.code == 0, done.err
    return done


def test_equal_teams_exceed_no_dealt_out_laps_and_an_offset_one_does(compared):
    numbers = compared.summary
    for p, q in PAIRS:
        whole, given = (numbers[f"{kind}_{p}_{q}_nats"] for kind in ("excess", "excess_given_station"))
        if "green" in (p, q):
            assert whole > 0.5
            assert given > 1.5
        else:
            assert abs(whole) < 0.2
            assert abs(given) < 0.4
    told = {(row["P"], row["Q"]): row for row in compared.table("pairs")}
    assert all(float(row["low"]) < float(row["divergence [nats]"]) < float(row["high"]) for row in told.values())


def test_offsets_and_distances_are_those_that_were_driven(compared):
    rows = {row["team"]: row for row in compared.table("teams")}
    told = {(row["P"], row["Q"]): row for row in compared.table("pairs")}
    for name, drive in TEAMS.items():
        left = drives.RADIUS - np.hypot(drive["x"], drive["y"])
        row = rows[name]
        assert float(row["offset [m]"]) == pytest.approx(left.mean(), abs=0.02)
        assert float(row["its deviation [m]"]) == pytest.approx(left.std(), abs=0.02)
        assert float(row["time of a run [s]"]) == pytest.approx(LENGTH / SPEED, abs=0.2)
        assert float(row["speed [m/s]"]) == pytest.approx(drive["v"].mean(), rel=0.01)
        assert row["runs"] == "3"
    apart = float(rows["green"]["offset [m]"]) - float(rows["red"]["offset [m]"])
    for pair in (("red", "green"), ("green", "red")):
        assert 0.7 * apart < float(told[pair]["mean to line [m]"]) <= float(told[pair]["mean to samples [m]"])
        assert float(told[pair]["mean to samples [m]"]) < 1.05 * apart
    assert compared.summary["course_m"] == pytest.approx(LENGTH, rel=1e-3)


def test_areas_are_those_of_the_config_and_divide_the_samples(compared):
    rows = compared.table("areas")
    assert [row["area"] for row in rows] == ["north"] * 6 + ["south"] * 6
    assert [(row["P"], row["Q"]) for row in rows] == PAIRS * 2
    samples = {row["team"]: int(row["samples"]) for row in compared.table("teams")}
    for north, south in zip(rows[:6], rows[6:], strict=True):
        # Nobody asked for the last 10.8 m of three laps.
        assert 12 <= samples[north["P"]] - int(north["samples"]) - int(south["samples"]) <= 18
        assert float(north["mean [m]"]) <= float(north["rmse [m]"])
    page = (compared.directory / "report.html").read_text()
    assert "<td>north</td>" in page
    assert "<td>south</td>" in page


def test_a_frozen_log_gets_a_verdict_and_spoils_nothing(home, compared):
    still = drives.laps(4)
    drives.team(home / "spoilt", "white", {**still, "x": 0 * still["x"] + 20, "y": 0 * still["y"], "v": 0 * still["v"]})
    done = run(home, "files=[teams/*/*.csv,spoilt/white/*.csv]", *LAPS)
    assert done.code == 0, done.err
    verdicts = {row["log"]: row["verdict"] for row in done.table("logs")}
    assert len(verdicts) == 12
    assert all(("frozen" in verdict) == name.startswith("white") for name, verdict in verdicts.items())
    assert done.out.count("Left out: white") == 3
    assert done.summary == {**compared.summary, "logs": 12, "logs_left_out": 3}


def test_laps_of_one_file_are_cut_where_the_first_comes_round(home, compared):
    for name, drive in TEAMS.items():
        drives.save(home / "whole" / f"{name}.csv", {key: drive[key] for key in "txyv"})
    done = run(home, "files=[whole/*.csv]", *BASE, COLUMNS, "format.path='{team}'", "course.line=''")
    assert done.code == 0, done.err
    assert done.summary["course_m"] == pytest.approx(LENGTH, rel=0.02)
    for row in done.table("teams"):
        assert row["runs"] == "3"
        assert float(row["time of a run [s]"]) == pytest.approx(LENGTH / SPEED, abs=0.1)
    for p, q in PAIRS:
        key = f"excess_{p}_{q}_nats"
        assert done.summary[key] == pytest.approx(compared.summary[key], abs=0.1)


def test_one_long_parquet_file_in_other_units_gives_the_same_numbers(home, compared):
    columns: dict[str, list] = {name: [] for name in ("ms", "feet_x", "feet_y", "mph", "who", "lap")}
    for name in sorted(TEAMS):
        drive = TEAMS[name]
        values = (1000 * drive["t"], drive["x"] / 0.3048, drive["y"] / 0.3048, drive["v"] / 0.44704)
        values = (*values, np.full(len(drive["t"]), name), drive["lap"].astype(str))
        for column, value in zip(columns.values(), values, strict=True):
            column += value.tolist()
    pyarrow.parquet.write_table(pyarrow.table(columns), home / "all.parquet")
    names = "format.columns={time: ms, x: feet_x, y: feet_y, speed: mph, vehicle: who, team: who, run: lap}"
    units = "format.units={time: ms, position: ft, speed: mph}"
    done = run(home, "files=[all.parquet]", *BASE, names, units, "format.layout=long")
    assert done.code == 0, done.err
    assert done.summary == pytest.approx(compared.summary, abs=2e-3)


def test_a_platoon_whose_last_vehicle_varies_twice_as_much_has_gain_two(followed):
    numbers = followed.summary
    assert numbers["road_one_head_deviation_mps"] == pytest.approx(math.sqrt(0.5), rel=1e-3)
    assert numbers["road_one_gain_whole"] == pytest.approx(2.0, rel=1e-3)
    assert numbers["road_one_gain_moving"] == pytest.approx(2.0, rel=1e-3)
    assert numbers["road_one_gain_whole_low"] <= 2.0 + 1e-3
    assert numbers["road_one_gain_whole_high"] >= 2.0 - 1e-3
    (row,) = followed.table("platoons")
    assert (row["vehicles"], float(row["duration [s]"])) == ("3", pytest.approx(59.9))
    assert float(row["time gap, median [s]"]) == pytest.approx(20.5 / 10, rel=0.05)
    vehicles = followed.table("vehicles")
    assert [float(v["speed deviation [m/s]"]) for v in vehicles] == pytest.approx(
        [gain * math.sqrt(0.5) for gain in (1.0, 1.4, 2.0)], rel=1e-3
    )


def test_the_divergence_of_an_offset_team_grows_as_the_logarithm_of_the_spacing(explained):
    coarse, fine = explained.table("spacings")
    grown = float(fine["offset team, mean [nats]"]) - float(coarse["offset team, mean [nats]"])
    assert grown == pytest.approx(2 * math.log(10), abs=0.7)
    for row in (coarse, fine):
        assert float(row["r [m]"]) == pytest.approx(float(row["spacing [m]"]), rel=0.1)
        measured = float(row["offset team, mean [nats]"])
        assert measured == pytest.approx(float(row["2 log(s / r) [nats]"]), abs=0.1)
    assert float(coarse["other teams, mean [nats]"]) < 0.0


@pytest.mark.parametrize("name", ["compared", "followed", "explained"])
def test_a_run_is_whole(name, request):
    done = request.getfixturevalue(name)
    assert done.out.rstrip().splitlines()[-1] == f"run directory: {done.directory.relative_to(done.home)}"
    assert all(isinstance(value, int | float) and math.isfinite(value) for value in done.summary.values())
    assert json.loads((done.directory / "manifest.json").read_text())["status"] == "complete"
    page = (done.directory / "report.html").read_text()
    assert page.count("data:image/png;base64") == len(list(done.directory.glob("*.png"))) > 0
    assert 'src="http' not in page
    assert 'href="http' not in page
    assert "nan" not in page.split("base64")[0].lower()
    tables = sorted(done.directory.glob("*.csv"))
    assert tables
    for table in tables:
        columns = pyarrow.parquet.read_table(table.with_suffix(".parquet")).to_pydict()
        rows = [
            {k: "" if v is None else str(v) for k, v in zip(columns, row, strict=True)}
            for row in zip(*columns.values(), strict=True)
        ]
        assert rows == done.table(table.stem)


@pytest.mark.slow
def test_rollouts_of_the_stack_are_compared_by_tau(tmp_path):
    done = run(tmp_path, "preset=smoke")
    assert done.code == 0, done.err
    assert [row["team"] for row in done.table("teams")] == ["tau 0", "tau 1"]
    assert [row["tau"] for row in done.table("safety")] == ["0.0", "1.0"]
    assert all(math.isfinite(value) for value in done.summary.values())
