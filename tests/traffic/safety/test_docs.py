"""The table of special cases in docs/safety.md is what the functions return."""

import importlib
import re
from pathlib import Path

import jax
import numpy as np
import pytest

from tests.traffic.safety.scenes import drive, objects
from urbanjax.traffic.safety.measure import SafetyParams, measure

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "safety.md").read_text()
TABLES = [[cell.strip() for cell in line.strip("|").split("|")] for line in PAGE.splitlines() if line.startswith("|")]
ROWS = [row for row in TABLES if len(row) == 10 and re.match(r"-?\d", row[1])]
NAMED = [name for row in TABLES if len(row) == 3 for name in re.findall(r"`([\w.]+)`", row[2])]


@pytest.fixture(scope="module")
def measured():
    return jax.jit(lambda tracks: measure(tracks, 0.1, params=SafetyParams()))


@pytest.mark.parametrize("row", ROWS, ids=[row[0] for row in ROWS])
def test_every_row_of_special_cases(measured, row):
    absent = row[2] == "absent"
    x, y, heading, speed = [0.0] * 4 if absent else [float(cell) for cell in row[2].split(",")]
    start = objects([[0, 0], [x, y]], np.deg2rad([0, heading]), [float(row[1]), speed], valid=[True, not absent])
    found = measured(drive(start, 81, 0.1))
    series, following = found.series, found.series.following
    values = (
        *(v[0, 0] for v in (following.ttc, series.box_ttc, following.time_gap, following.headway)),
        following.deceleration[0, 0],
        found.summary.min_pet[0],
        series.rss_margin[0, 0],
    )
    np.testing.assert_allclose(np.array(values), [float(cell) for cell in row[3:]], atol=0.0051)


def test_the_table_has_the_cases_that_matter():
    names = " ".join(row[0] for row in ROWS)
    for word in (
        "equal",
        "stand",
        "behind",
        "parallel",
        "diverging",
        "crossing",
        "oncoming",
        "touching",
        "overlapping",
    ):
        assert word in names
    assert "absent" in names


@pytest.mark.parametrize("name", NAMED)
def test_functions_named_in_the_page_exist(name):
    module, _, function = name.rpartition(".")
    found = importlib.import_module(f"urbanjax.traffic.safety.{module or 'exposure'}")
    assert callable(getattr(found, function))
