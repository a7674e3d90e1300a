"""Logs from CSV, JSON and Parquet: known values in SI units, policies, units that do not fit."""

import json

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest

from tests.io.logs import formats
from tests.io.logs.formats import F1, LONG, OPENACC, csv_text, drive, form, write
from urbanjax.io import logs
from urbanjax.io.logs import LogError, LogFormat, agreement
from urbanjax.types import ConfigError
from urbanjax.types.config import schema, to_params

PLAIN = {"columns": {"time": "time", "x": "x", "y": "y", "speed": "speed"}}


def plain(n=40, **changes):
    time, position, speed, _ = drive(n)
    return {"time": time, "x": position[:, 0], "y": position[:, 1], "speed": speed, **changes}


def test_a_wide_file_gives_one_log_per_vehicle_that_has_columns(tmp_path):
    found = logs.read(write(tmp_path, formats.wide(), "handling.csv"), form(OPENACC))
    time, position, speed, _ = drive(12)
    assert [(log.vehicle, log.team, log.run) for log in found] == [
        ("ALFA", "ALFA", "handling"),
        ("CHARLIE", "CHARLIE", "handling"),
    ]
    for log, number in zip(found, (1, 3), strict=True):
        np.testing.assert_allclose(log.time, time)
        np.testing.assert_allclose(log.position, position - [9 * number, 0], atol=1e-6)
        np.testing.assert_allclose(log.speed, speed)
        np.testing.assert_array_equal(log.rows, 7 + np.arange(12))  # lines of the file
        assert log.report.speed_ratio == pytest.approx(1.0, abs=2e-3)


def test_one_file_per_lap_takes_team_and_lap_from_its_path(tmp_path):
    for name in ("HAM/24_tel.json", "VER/3_tel.json"):
        write(tmp_path, formats.telemetry(), name)
    found = logs.read(tmp_path / "*" / "*_tel.json", form(F1))
    assert [(log.team, log.vehicle, log.run) for log in found] == [("HAM", "HAM", "24"), ("VER", "VER", "3")]
    time, position, speed, _ = drive(12)
    np.testing.assert_allclose(found[0].position, position, atol=1e-9)
    np.testing.assert_allclose(found[0].speed, speed)
    np.testing.assert_allclose(found[0].time, time)
    with pytest.raises(LogError, match="path does not end"):
        logs.read(write(tmp_path, formats.telemetry(), "HAM/24.json"), form(F1))


@pytest.mark.parametrize("suffix", ["csv", "json", "records.json", "parquet", "coded.parquet"])
def test_a_long_file_gives_the_same_logs_in_every_format(tmp_path, suffix):
    columns, path = formats.long(), tmp_path / f"mixed.{suffix}"
    if suffix == "csv":
        path.write_text(csv_text(columns))
    elif suffix == "json":
        path.write_text(json.dumps(columns))
    elif suffix == "records.json":
        records = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
        path.write_text(json.dumps({"logs": {"all": records}}))
    else:
        table = pyarrow.table(columns)
        if suffix == "coded.parquet":
            table = table.set_column(1, "id", table["id"].dictionary_encode())
        pyarrow.parquet.write_table(table, path)
    found = logs.read(path, form(LONG, records="logs.all" if suffix == "records.json" else ""))
    assert [(log.vehicle, log.team) for log in found] == [("a", "red"), ("7", "blue")]
    time, position, speed, heading = drive(8)
    for log, shift, first in zip(found, (0.0, 30.48), (0, 1), strict=True):
        np.testing.assert_allclose(log.time, time)
        np.testing.assert_allclose(log.position, position + np.array([shift, 0]), atol=1e-9)
        np.testing.assert_allclose(log.speed, speed)
        np.testing.assert_allclose(log.heading, heading, atol=1e-12)
        np.testing.assert_array_equal(log.rows, 2 * np.arange(8) + first + (2 if suffix == "csv" else 0))


def test_the_format_is_a_config():
    assert to_params(LogFormat, schema(LogFormat)) == LogFormat()
    with pytest.raises(ConfigError, match=r"'units.speed' must be one of m/s, km/h"):
        to_params(LogFormat, {"units": {"speed": "auto"}})
    with pytest.raises(ConfigError, match=r"nearest valid key is 'columns.x'"):
        to_params(LogFormat, {"columns": {"xx": "E"}})


def test_empty_cells_and_words_for_nothing_are_absent(tmp_path):
    columns = {k: [str(v) for v in values] for k, values in plain().items()}
    columns["x"][3], columns["y"][4], columns["time"][5], columns["speed"][6] = "", "None", " ", "null"
    columns["x"][7] = columns["y"][7] = columns["time"][7] = columns["speed"][7] = ""
    (log,) = logs.read(write(tmp_path, csv_text(columns), "log.csv"), form(PLAIN))
    assert (log.n, log.report.rows, log.report.absent, log.report.dropped) == (36, 40, 4, 4)
    np.testing.assert_array_equal(log.rows, [k + 2 for k in range(40) if k not in (3, 4, 5, 7)])
    assert np.flatnonzero(np.isnan(log.speed)).tolist() == [3]
    assert log.report.speed_ratio == pytest.approx(1.0, abs=2e-3)


POLICIES = [
    ("x", "nan", "line 7, column 'x': nan is not finite", "not_finite", "drop"),
    ("time", "inf", "line 7, column 'time': inf is not finite", "not_finite", "drop"),
    ("time", "5.4", "line 7, column 'time': 5.4 s is said twice, at different pos.*see line 6", "duplicates", "first"),
]


@pytest.mark.parametrize(("column", "value", "message", "key", "policy"), POLICIES)
def test_what_a_log_cannot_hold_is_refused_or_left_out_and_counted(tmp_path, column, value, message, key, policy):
    columns = {k: [str(round(v, 9)) for v in values] for k, values in plain().items()}
    columns[column][5] = value
    path = write(tmp_path, csv_text(columns), "log.csv")
    with pytest.raises(LogError, match=message) as caught:
        logs.read(path, form(PLAIN))
    assert str(caught.value).startswith(path.as_posix())
    (log,) = logs.read(path, form(PLAIN, **{key: policy}))
    assert getattr(log.report, key) == log.report.dropped == 1
    np.testing.assert_array_equal(log.rows, [k + 2 for k in range(40) if k != 5])


def test_an_unordered_log_is_refused_or_sorted(tmp_path):
    columns = plain()
    order = np.array([*range(5), 6, 5, *range(7, 40)])
    path = write(tmp_path, csv_text({k: v[order] for k, v in columns.items()}), "log.csv")
    with pytest.raises(LogError, match=r"line 8, column 'time': 5.5 s is earlier than 5.6 s"):
        logs.read(path, form(PLAIN))
    (log,) = logs.read(path, form(PLAIN, time_order="sort"))
    np.testing.assert_array_equal(log.time, columns["time"])
    np.testing.assert_array_equal(log.position[:, 0], columns["x"])
    assert log.report.unordered == 1
    assert log.rows[[5, 6]].tolist() == [8, 7]


def test_equal_samples_are_refused_or_left_out_and_unequal_ones_never_dropped(tmp_path):
    lines = csv_text(plain()).splitlines()
    path = write(tmp_path, "\n".join([*lines[:9], lines[8], *lines[9:]]), "log.csv")
    with pytest.raises(LogError, match=r"line 10, column 'time': .* is said twice; leave it out .* see line 9"):
        logs.read(path, form(PLAIN))
    (log,) = logs.read(path, form(PLAIN, duplicates="drop"))
    assert (log.n, log.report.duplicates) == (40, 1)
    lines[8] = lines[8].replace(lines[8].split(",")[1], "0.5")
    lines.insert(8, csv_text(plain()).splitlines()[8])
    with pytest.raises(LogError, match="different positions"):
        logs.read(write(tmp_path, "\n".join(lines), "log.csv"), form(PLAIN, duplicates="drop"))


@pytest.mark.parametrize(
    ("stated", "actual"),
    [
        ({}, {"speed": "km/h"}),
        ({"speed": "km/h"}, {}),
        ({}, {"speed": "mph"}),
        ({"speed": "km/h"}, {"speed": "mph"}),
        ({}, {"position": "dm"}),
        ({"position": "ft"}, {}),
        ({}, {"time": "ms"}),
        ({"time": "min"}, {}),
    ],
)
def test_a_unit_that_does_not_fit_is_named_with_the_one_that_does(tmp_path, stated, actual):
    factor = {"time": {"ms": 1000}, "position": {"dm": 10}, "speed": {"km/h": 3.6, "mph": 1 / 0.44704}}
    columns = plain()
    for role, unit in actual.items():
        for name in ("x", "y") if role == "position" else (role,):
            columns[name] = columns[name] * factor[role][unit]
    path = write(tmp_path, csv_text(columns), "log.csv")
    role = next(iter({**stated, **actual}))
    true = actual.get(role, {"speed": "m/s", "position": "m", "time": "s"}[role])
    with pytest.raises(LogError, match=rf"column 'speed'.* times .*looks like .*units\.{role}={true}"):
        logs.read(path, form(PLAIN, units=stated))
    logs.read(path, form(PLAIN, units=actual))


def test_a_stretch_in_another_unit_is_noted(tmp_path):
    columns = plain(200)
    columns["speed"][150:] *= 3.6
    (log,) = logs.read(write(tmp_path, csv_text(columns), "log.csv"), form(PLAIN))
    assert len(log.report.notes) == 1
    assert "3.6 times" in log.report.notes[0]
    assert log.report.speed_ratio == pytest.approx(1.0, abs=2e-3)


def test_a_speed_that_is_nowhere_above_zero_is_noted_and_not_compared(tmp_path):
    columns = plain(speed=np.zeros(40))
    (log,) = logs.read(write(tmp_path, csv_text(columns), "log.csv"), form(PLAIN))
    assert log.report.notes == ("the stated speed is 0 throughout",)
    assert np.isnan(log.report.speed_ratio)


def test_a_standstill_does_not_enter_the_comparison_of_speeds():
    _, position, speed, _ = drive(100)
    rest = np.repeat(position[-1:], 400, axis=0) + np.random.default_rng(0).normal(0, 0.02, (400, 2))
    log = logs.from_arrays(
        "a",
        np.arange(500) / 10,
        position=np.concatenate([position, rest]),
        speed=np.concatenate([speed, np.full(400, 0.01)]),
    )
    at, ratios = agreement.speed_ratios(log)
    assert len(ratios) == 10
    assert at.max() < 100
    np.testing.assert_allclose(np.median(ratios), 1.0, atol=2e-3)


def test_arrays_become_a_log_or_are_refused():
    time, position, speed, _ = drive(5)
    log = logs.from_arrays("ego", time, position=position, speed=speed, team="ours", run="1")
    assert (log.name, log.n, log.rows.tolist()) == ("ours ego 1", 5, [0, 1, 2, 3, 4])
    for wrong in (time[::-1], time * np.nan, time[:4], time[None]):
        with pytest.raises(LogError, match="log ego"):
            logs.from_arrays("ego", wrong, position=position)
    with pytest.raises(LogError, match="speed"):
        logs.from_arrays("ego", time, position=position, speed=speed[1:])
    bare = logs.from_arrays.__wrapped__
    with pytest.raises(LogError, match="log ego: time: str is no array of real numbers"):
        bare("ego", "x", position=position)
    with pytest.raises(LogError, match="log ego: has no field 'sped': use of speed, heading"):
        bare("ego", time, position=position, sped=speed)


def test_a_heading_in_another_unit_or_sense_is_refused_and_one_that_is_neither_noted(tmp_path):
    columns = formats.long(60)
    path = write(tmp_path, csv_text(columns), "log.csv")
    for log in logs.read(path, form(LONG)):
        assert log.report.notes == ()
    for units, message in (({"compass": False}, "units.compass=true"), ({"heading": "rad"}, "units.heading=deg")):
        with pytest.raises(LogError, match=f"column 'psi': the stated heading of .* looks like {message}"):
            logs.read(path, form(LONG, units={**LONG["units"], **units}))
    columns["psi"] = [angle + 180 for angle in columns["psi"]]
    for log in logs.read(write(tmp_path, csv_text(columns), "log.csv"), form(LONG)):
        assert len(log.report.notes) == 1
        assert "heading" in log.report.notes[0]


def test_degrees_are_told_where_their_number_in_radians_comes_near_the_way(tmp_path):
    """Due north is 1.57 rad, and 90 rad is 2.04 beyond fourteen turns."""
    path = tmp_path / "north.csv"
    path.write_text("time,x,y,psi\n" + "".join(f"{k / 10},0,{k},90\n" for k in range(60)))
    north = logs.LogFormat(columns=logs.Columns(heading="psi"))
    with pytest.raises(LogError, match=r"units\.heading=deg"):
        logs.read(path, north)
