"""Logs that are broken, by hand and at random: each is read, or refused by an error that names the file."""

import random
import re
import time

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest

from tests.io.logs import formats
from tests.io.logs.formats import F1, LONG, OPENACC, csv_text, drive, form, write
from urbanjax.io import files, logs
from urbanjax.io.logs import Columns, LogError, LogFormat, Units, csv_table, parquet_table, reader
from urbanjax.types import ConfigError

PLAIN = {"columns": {"time": "time", "x": "x", "y": "y", "speed": "speed"}}
TIME, POSITION, SPEED, _ = drive(6)
ROWS = "\n".join(f"{t:.1f},{x:.3f},{y:.3f},{v:.1f}" for t, (x, y), v in zip(TIME, POSITION, SPEED, strict=True))
GOOD = f"time,x,y,speed\n{ROWS}\n"
TEL = formats.telemetry()

BY_HAND = {
    "empty": ("log.csv", b"", PLAIN, "is empty"),
    "blank": ("log.csv", b" \n\n", PLAIN, "is empty"),
    "header only": ("log.csv", b"time,x,y,speed\n", PLAIN, "line 2: there are no rows below the header"),
    "cut off": ("log.csv", GOOD[:-10].encode(), PLAIN, "line 7: has 3 cells, the header 4; the file is cut off"),
    "no number": ("log.csv", GOOD.replace("5.3", "5.3s").encode(), PLAIN, "line 5, column 'time': '5.3s' is no number"),
    "underscore": ("log.csv", GOOD.replace("5.3", "5_3").encode(), PLAIN, "line 5, column 'time': '5_3' is no number"),
    "one sample": ("log.csv", "\n".join(GOOD.split("\n")[:2]).encode(), PLAIN, "vehicle log has 1 samples"),
    "too far": ("log.csv", GOOD.replace("5.3", "1e300").encode(), PLAIN, "line 5, column 'time': 1e.300 is beyond"),
    "delimiter": ("log.csv", GOOD.replace(",", ";").encode(), PLAIN, "column 'time' is missing; .*time;x;y;speed"),
    "other case": ("log.csv", GOOD.replace("speed", "Speed").encode(), PLAIN, "'speed' is missing; .* 'Speed'"),
    "twice": ("log.csv", GOOD.replace("speed", "x").encode(), PLAIN, "column 'x' is there more than once"),
    "latin": ("log.csv", GOOD.replace("5.3", "5.3\xb5").encode("latin1"), PLAIN, "line 5: is not UTF-8"),
    "utf-16": ("log.csv", GOOD.encode("utf-16"), PLAIN, "is UTF-16; save it as UTF-8"),
    "zeros": ("log.csv", GOOD.replace("5.3", "\0").encode(), PLAIN, "line 5: holds a zero byte"),
    "suffix": ("log.xls", GOOD.encode(), PLAIN, "a log ends in .csv, .txt, .json, .parquet, not in '.xls'"),
    "short preamble": ("log.csv", b"a\nb\n", OPENACC, "the header is expected in line 6"),
    "no order": ("log.csv", formats.wide().replace("Vehicle_order", "Order").encode(), OPENACC, "'Vehicle_order'"),
    "too few names": ("log.csv", formats.wide().replace(",CHARLIE,DELTA,ECHO", "").encode(), OPENACC, "3 has no name"),
    "no wide columns": (
        "log.csv",
        formats.wide().replace("E", "e").encode(),
        OPENACC,
        "column 'E1' is missing; .*'e1'",
    ),
    "no wide speed": ("log.csv", formats.wide().replace("Speed3", "V3").encode(), OPENACC, "'Speed3' is missing"),
    "no vehicle": ("log.csv", b"t,x,y,v,psi,id,group\n1,2,3,4,5,,a\n", LONG, "line 2, column 'id': '' is no name"),
    "json cut off": ("HAM/1_tel.json", TEL[:200].encode(), F1, "line 1: is no JSON .*cut off"),
    "json number": ("HAM/1_tel.json", b"12", F1, "neither columns nor a list of records"),
    "json deep": ("HAM/1_tel.json", b"[" * 100_000, F1, "is no JSON"),
    "json long number": ("HAM/1_tel.json", b'{"tel": ' + b"9" * 5000 + b"}", F1, "is no JSON that can be read"),
    "json columns": ("HAM/1_tel.json", TEL.replace('"x"', '"px"').encode(), F1, "'tel.x' is missing; .*'tel.px'"),
    "json uneven": (
        "HAM/1_tel.json",
        TEL.replace('"x": [', '"x": [0, ').encode(),
        F1,
        "different lengths: .*'tel.x' 13",
    ),
    "json text": ("HAM/1_tel.json", TEL.replace('"x": [', '"x": ["e", ').encode(), F1, "different lengths"),
    "json group": ("HAM/1_tel.json", TEL.replace('"x": [0.0', '"x": [[]').encode(), F1, r"element 0, column .* '\[\]'"),
    "json true": (
        "HAM/1_tel.json",
        TEL.replace('"x": [0.0', '"x": [true').encode(),
        F1,
        "element 0, .* 'True' is no num",
    ),
    "json huge": ("HAM/1_tel.json", TEL.replace('"x": [0.0', '"x": [1' + "0" * 400).encode(), F1, "inf is not finite"),
    "no parquet": ("log.parquet", b"PAR1" + bytes(40) + b"PAR1", PLAIN, "is no Parquet file, or cut off"),
}


@pytest.mark.parametrize("case", BY_HAND)
def test_a_broken_log_is_refused_with_file_place_and_fault(tmp_path, case):
    name, data, values, message = BY_HAND[case]
    path = write(tmp_path, data, name)
    with pytest.raises(LogError, match=message) as caught:
        logs.read(path, form(values))
    assert str(caught.value).startswith(f"{path.as_posix()}: ")


def test_harmless_differences_are_read(tmp_path):
    for k, data in enumerate(
        [
            b"\xef\xbb\xbf" + GOOD.encode(),
            GOOD.replace("\n", "\r\n").encode(),
            f"# {GOOD}\n\n".encode(),
            GOOD.replace("time,x", '"time", "x"').replace("5.3,", " +5.3 ,").encode(),
        ]
    ):
        (log,) = logs.read(write(tmp_path, data, f"{k}.csv"), form(PLAIN))
        np.testing.assert_allclose(log.time, TIME)
        np.testing.assert_allclose(log.position, POSITION, atol=1e-3)


def test_files_that_are_not_there_or_are_too_large_are_refused(tmp_path, monkeypatch):
    path = write(tmp_path, GOOD, "log.csv")
    for wrong, message in (
        (tmp_path / "other.csv", "there is no such file"),
        (tmp_path / "*.json", "no file has such a name"),
        (tmp_path, "is a folder"),
        ([], "no log files are named"),
    ):
        with pytest.raises(LogError, match=message):
            logs.read(wrong, form(PLAIN))
    monkeypatch.setattr(reader, "LARGEST", 20)
    with pytest.raises(LogError, match="more than the 20 that it may have"):
        logs.read(path, form(PLAIN))
    assert reader.LARGEST <= files.LARGEST
    monkeypatch.setattr(reader, "LARGEST", 10_000)
    monkeypatch.setattr(parquet_table, "MOST_CELLS", 20)
    pyarrow.parquet.write_table(columns_of(GOOD), tmp_path / "log.parquet")
    with pytest.raises(LogError, match="6 rows are too many"):
        logs.read(tmp_path / "log.parquet", form(PLAIN))


def test_a_pattern_and_a_list_name_each_file_once(tmp_path):
    paths = [write(tmp_path, GOOD, f"{name}.csv") for name in ("b", "a")]
    assert [log.run for log in logs.read([paths[0], tmp_path / "*.csv"], form(PLAIN))] == ["b", "a"]


MADE = {
    "columns": (lambda: LogFormat(columns=3), "LogFormat.columns is 3: it must be a Columns"),
    "dict": (lambda: LogFormat(columns={}), "LogFormat.columns is .*: it must be a Columns"),
    "no columns": (lambda: LogFormat(columns=None), "'columns' is a NoneType: give a Columns"),
    "units": (lambda: LogFormat(units="m"), "LogFormat.units is 'm': it must be a Units"),
    "column": (lambda: LogFormat(columns=Columns(speed=3)), "Columns.speed is 3: it must be a text"),
    "delimiter": (lambda: LogFormat(delimiter=None), "LogFormat.delimiter is None: it must be a text"),
    "preamble": (lambda: LogFormat(preamble=1.5), "LogFormat.preamble is 1.5: it must be a whole number"),
    "path": (lambda: LogFormat(path=3), "LogFormat.path is 3: it must be a text"),
    "records": (lambda: LogFormat(records=["tel"]), "LogFormat.records is .*: it must be a text"),
    "factor": (lambda: LogFormat(speed_factor="x"), "LogFormat.speed_factor is 'x': it must be a number"),
    "no factor": (lambda: LogFormat(speed_factor=None), "LogFormat.speed_factor is None: it must be a number"),
    "choice": (lambda: LogFormat(not_finite=[]), r"LogFormat.not_finite is \[\]: use one of error, drop"),
    "layout": (lambda: LogFormat(layout=[]), r"LogFormat.layout is \[\]: use one of single"),
    "switch": (lambda: LogFormat(units=Units(compass="x")), "Units.compass is 'x': it must be true or false"),
    "x twice": (lambda: LogFormat(columns=Columns(x="x", y="x")), "'columns.x' and 'columns.y' are both 'x'"),
    "time as x": (lambda: LogFormat(columns=Columns(time="x")), "'columns.time' and 'columns.x' are both 'x'"),
    "y as time": (lambda: LogFormat(columns=Columns(y="time")), "'columns.time' and 'columns.y' are both 'time'"),
    "vehicle": (lambda: LogFormat(columns=Columns(vehicle="x")), "'columns.x' and 'columns.vehicle' are both 'x'"),
    "single": (lambda: LogFormat(columns=Columns(vehicle="id")), "'columns.vehicle' is read in the long layout only"),
}


@pytest.mark.parametrize("case", MADE)
def test_what_is_no_format_is_refused(case):
    make, message = MADE[case]
    bare = reader.check.__wrapped__  # past the suite's own check of types
    with pytest.raises((LogError, ConfigError), match=message) as caught:
        bare(make())
    assert "\n" not in str(caught.value)


def test_formats_made_in_code_are_checked(tmp_path):
    path = write(tmp_path, GOOD, "log.csv")
    base = form(PLAIN)
    for wrong, message in (
        (base.replace(layout="long"), "'columns.vehicle' is empty"),
        (base.replace(layout="wide"), "must hold {i}"),
        (base.replace(columns=base.columns.replace(x="")), "'columns.x' is empty"),
        (base.replace(delimiter=""), "'delimiter' must be one character"),
        (base.replace(path="{run}/{run}"), "holds one name twice"),
    ):
        with pytest.raises(LogError, match=message):
            logs.read(path, wrong)
    with pytest.raises(ConfigError, match=r"Units.speed is 'kmh': use one of m/s, km/h"):
        base.units.replace(speed="kmh")
    with pytest.raises(ConfigError, match=r"LogFormat.layout is 'broad': use one of single, long, wide"):
        base.replace(layout="broad")


def test_vehicles_with_too_few_samples_may_be_left_out(tmp_path):
    path = write(tmp_path, re.sub(r",[-\d.]+,[-\d.]+,[-\d.]+$", ",,,", formats.wide(), flags=re.M), "log.csv")
    with pytest.raises(LogError, match="vehicle CHARLIE has 0 samples"):
        logs.read(path, form(OPENACC))
    assert [log.vehicle for log in logs.read(path, form(OPENACC, short="drop"))] == ["ALFA"]


def columns_of(text):
    names, *rows = (line.split(",") for line in text.strip().split("\n"))
    return pyarrow.table({name: [float(row[k]) for row in rows] for k, name in enumerate(names)})


VALUES = [
    "",
    "nan",
    "inf",
    "-1",
    "0",
    "1e7",
    "1e308",
    "9" * 30,
    "٣",
    "abc",
    "1_0",
    '"',
    "null",
    "None",
    "[]",
    "{",
    "true",
]


def mutated(text, dice):
    """The text with one to three faults, as bytes."""
    for _ in range(dice.randint(1, 3)):
        lines = text.split("\n")
        i, j = dice.randrange(len(lines)), dice.randrange(len(lines))
        number = dice.choice(list(re.finditer(r"[-\d.]+", text)) or [re.match("", text)])
        word = dice.choice(list(re.finditer(r"[A-Za-z]+\d?", text)) or [re.match("", text)])
        mark = dice.choice(list(re.finditer(r'[,\[\]{}":\n]', text)) or [re.match("", text)])
        match dice.randrange(8):
            case 0:
                text = "\n".join(lines[:i] + lines[i + 1 :])
            case 1:
                text = "\n".join(lines[: i + 1] + lines[i:])
            case 2:
                text = text[: number.start()] + dice.choice(VALUES) + text[number.end() :]
            case 3:
                text = text[: word.start()] + dice.choice(["", "x", "E9", "tel"]) + text[word.end() :]
            case 4:
                text = text[: mark.start()] + dice.choice(["", ",", "\n", '"', "]"]) + text[mark.end() :]
            case 5:
                lines[i], lines[j] = lines[j], lines[i]
                text = "\n".join(lines)
            case 6 if dice.random() < 0.3:
                text = text[: dice.randrange(len(text) + 1)]
            case 7 if dice.random() < 0.3:
                return dice.choice([text.encode("utf-16"), text.encode()[::-1], b"", text.encode() + b"\xff\0"])
    return text.encode()


def damaged(data, dice):
    """The bytes with some changed, taken out or cut off."""
    data = bytearray(data)
    for _ in range(dice.randint(1, 4)):
        k = dice.randrange(len(data))
        match dice.randrange(4):
            case 0:
                data[k] = dice.randrange(256)
            case 1:
                data[k] ^= 1 << dice.randrange(8)
            case 2:
                del data[k : k + dice.randint(1, 8)]
            case 3 if dice.random() < 0.3:
                del data[k:]
                break
    return bytes(data) or b"P"


@pytest.fixture(scope="module")
def parquet(tmp_path_factory):
    path = tmp_path_factory.mktemp("parquet") / "log.parquet"
    pyarrow.parquet.write_table(pyarrow.table(formats.long()), path)
    return path.read_bytes()


@pytest.mark.parametrize("kind", ["wide", "long", "json", "parquet"])
def test_a_log_broken_at_random_is_read_or_refused_by_name(tmp_path, kind, parquet):
    dice = random.Random(f"broken {kind}")
    name, values, source = {
        "wide": ("broken.csv", OPENACC, formats.wide()),
        "long": ("broken.csv", LONG, csv_text(formats.long())),
        "json": ("HAM/1_tel.json", F1, TEL.replace(", ", ",\n")),
        "parquet": ("broken.parquet", LONG, parquet),
    }[kind]
    logs.read(write(tmp_path, source, name), form(values))  # whole; and what the first of all reads loads is loaded
    errors, slowest = [], 0.0
    for _ in range(120):
        path = write(tmp_path, damaged(source, dice) if kind == "parquet" else mutated(source, dice), name)
        begin = time.process_time()
        try:
            found = logs.read(path, form(values))
        except LogError as error:
            errors.append(str(error))
        else:
            assert all(np.isfinite(log.position).all() and np.all(np.diff(log.time) > 0) for log in found)
        slowest = max(slowest, time.process_time() - begin)
    assert all(error.startswith(f"{path.as_posix()}: ") for error in errors)
    assert 20 < len(errors) < 118
    assert slowest < 0.5  # s of the processor, which others may share


def test_large_files_are_read_at_speed(tmp_path):
    n = 20_000
    time_, position, speed, _ = drive(n, dt=0.01)
    columns = {"time": time_, "x": position[:, 0], "y": position[:, 1], "speed": speed}
    path = write(tmp_path, csv_text({k: v.tolist() for k, v in columns.items()}), "log.csv")
    begin = time.process_time()
    (log,) = logs.read(path, form(PLAIN))
    assert time.process_time() - begin < 1.0  # 0.05 s measured
    assert log.n == n
    assert csv_table.load(path, path.read_bytes(), form=form(PLAIN)).names == ("time", "x", "y", "speed")
