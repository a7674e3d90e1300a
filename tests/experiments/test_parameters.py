"""One command lists what may be tuned of the closed loop, and how."""

import csv
import json

import jax
import pyarrow.parquet
import pytest

from experiments.parameters.study import ParameterStudy
from experiments.parameters.table import listed, write
from urbanjax.io.runs.directory import Run
from urbanjax.rollout import LoopParams
from urbanjax.types import ConfigError

WEIGHTS = "stack.planning.micro.weights"


def test_all_numbers_are_listed_and_written(tmp_path, capsys):
    run = Run(tmp_path / "run", {})
    write(ParameterStudy(), run)
    with open(run.path("parameters.csv"), encoding="utf-8") as file:
        rows = {row["key"]: row for row in csv.DictReader(file)}
    assert len(rows) == len(jax.tree.leaves(LoopParams()))
    assert rows["stack.behavior.gvp.tau"] == {
        "key": "stack.behavior.gvp.tau",
        "value": "0.75",
        "unit": "[-]",
        "low": "0.0",
        "high": "1.0",
        "transform": "logit",
        "scale": "0.1875",
        "tunable": "True",
        "why_fixed": "",
    }
    assert rows["period"]["tunable"] == "False"
    assert rows["period"]["why_fixed"].startswith("fact: ")
    table = pyarrow.parquet.read_table(run.path("parameters.parquet")).to_pydict()
    assert table["key"] == list(rows)
    summary = json.loads(run.path("summary.json").read_text())
    assert summary["numbers"] == len(rows) == summary["tunable"] + summary["fixed"]
    assert summary["tunable"] == sum(table["tunable"])
    assert f"{summary['tunable']} of them tunable" in capsys.readouterr().out


def test_a_reader_sees_groups_with_bounds_and_reasons(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    write(ParameterStudy(pattern=WEIGHTS), Run(tmp_path / "run", {}))
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert lines[0] == WEIGHTS
    assert "length 1 per m 0 - fixed, scale: the unit of all weights is metres of way" in lines
    assert "curvature 2 per rad of turn 0 - log tunable" in lines
    assert lines[-1] == "9 numbers, 8 of them tunable"


def test_what_is_listed_is_filtered():
    assert [number.key for number in listed(ParameterStudy(pattern="*.tau"))] == ["stack.behavior.gvp.tau"]
    tunable, fixed = (listed(ParameterStudy(only=only)) for only in ("tunable", "fixed"))
    assert all(number.tunable for number in tunable)
    assert len(tunable) + len(fixed) == len(listed(ParameterStudy()))


@pytest.mark.parametrize(
    ("pattern", "only", "message"),
    [
        ("*.taus", "all", r"'\*\.taus' is no continuous number; the nearest valid key is"),
        ("sim.*", "tunable", r"'sim\.\*' means no number that is tunable, all are fixed, as 'sim\..*': fact: of the"),
        ("*.tau", "fixed", r"'\*\.tau' means no number that is fixed, all are tunable"),
    ],
)
def test_what_leaves_nothing_to_list_is_refused(pattern, only, message):
    with pytest.raises(ConfigError, match=message):
        listed(ParameterStudy(pattern=pattern, only=only))
