"""Sweeps with little in them, torn files and directories that hold none: told as they are, and nothing lost."""

import json

import numpy as np
import pytest

from experiments.collect import scores, sweeps
from experiments.collect.report import write_sweep
from experiments.collect.scores import SweepScore
from tests.experiments import sweeps as made
from tests.experiments.sweeps import GRID, TAU, read, rising, rows_of
from urbanjax.types import ConfigError, FileError

DEGENERATE = {
    "one job": ([{TAU: 0.5}], "complete", {}),
    "one value": ([{TAU: 0.5, "missions": ["cut_in"]}, {TAU: 0.5, "missions": ["overtake"]}], "complete", {}),
    "no axis": ([{}], "complete", {}),
    "all failed": ([{TAU: 0.0}, {TAU: 1.0}], "failed", {}),
    "NaN": ([{TAU: 0.0}, {TAU: 1.0}], "complete", {"a": float("nan"), "a_low": None, "a_high": None}),
    "only summaries": (GRID, "complete", {"a": 1.0, "a_low": 0.5, "a_high": 1.5, "b": "text"}),
    "mixed values": (
        [{"x.y": 1}, {"x.y": "two"}, {"x.y": [3, "a"]}, {"x.y": None}, {"x.y": True}],
        "complete",
        {"a": 1},
    ),
}


@pytest.mark.parametrize("name", DEGENERATE)
def test_sweeps_with_little_in_them_are_told_as_they_are(name, tmp_path):
    values, status, summary = DEGENERATE[name]
    folder = made.plan(tmp_path / "s", values)
    for number in range(len(values)):
        rows = made.drives(0.5, seeds=1) if not summary and status == "complete" else None
        made.job(
            folder, number, rows=rows, summary=summary, status=status, error="ConfigError: x" if rows is None else None
        )
    counted = write_sweep(folder)
    assert counted.expected == len(values)
    assert counted.whole == (status == "complete")
    assert len(rows_of(folder / "table.csv")) == len(values)
    page = made.page(folder)
    assert ("There is no best job" in page) == (name in ("all failed", "NaN", "mixed values"))
    assert (folder / "best.yaml").exists() == (name not in ("all failed", "NaN", "mixed values"))
    assert ("nothing can be compared drive by drive" in page) == (name == "only summaries")


def test_of_hundreds_of_jobs_the_page_shows_some_and_the_table_all(tmp_path):
    folder = made.plan(tmp_path / "s", [{TAU: i / 300} for i in range(300)])
    for number in range(300):
        made.job(folder, number, summary={"a": number, "a_low": number - 1, "a_high": number + 1})
    write_sweep(folder)
    assert len(rows_of(folder / "table.csv")) == 300
    page = made.page(folder)
    assert "100 more rows are in table.csv" in page
    assert "s/00299 with 299" in page


def test_drives_without_a_score_are_no_drives_with_a_good_one(tmp_path):
    folder = made.sweep(tmp_path / "s", [{TAU: 0.0}, {TAU: 1.0}], rising)
    rows = made.drives(0.9)
    rows[3]["nuplan_total"] = float("nan")
    made.job(folder, 1, rows=rows)
    _, jobs, _, evidence = read(folder)
    assert np.isnan(evidence.of(jobs[1], "nuplan_total").value)
    assert scores.ranked(jobs, evidence, SweepScore("nuplan_total", True)) == jobs[:1]
    (folder / "00001" / "rows.parquet").write_bytes(b"PAR1 torn")
    write_sweep(folder)
    assert "cannot be read as rows of drives" in made.page(folder)


def test_a_torn_manifest_is_a_failed_job_and_the_rest_is_kept(tmp_path):
    folder = made.sweep(tmp_path / "s", [{TAU: 0.0}, {TAU: 0.5}, {TAU: 1.0}], rising)
    (folder / "00001" / "manifest.json").write_text('{"status": "comp')
    wrong = json.loads((folder / "00002" / "manifest.json").read_text()) | {"overrides": {TAU: 0.7}}
    (folder / "00002" / "manifest.json").write_text(json.dumps(wrong))
    _, jobs, _, _ = read(folder)
    assert [job.status for job in jobs] == ["complete", "failed", "failed"]
    assert "manifest.json, line 1, column" in jobs[1].error
    assert "other overrides than planned" in jobs[2].error
    (folder / "00001" / "manifest.json").unlink()
    assert read(folder)[1][1].error == "it has begun, but did not end"


PLANS = {
    "{": "line 1, column 2: is no JSON",
    "[]": "must hold entries by name",
    '{"experiment": "evaluate", "jobs": []}': "plans no jobs",
    '{"experiment": "evaluate"}': "its entry 'jobs' is missing",
    '{"jobs": [{"name": "0", "overrides": {}}]}': "its entry 'experiment' is missing",
    '{"experiment": "e", "jobs": [{"name": "../0", "overrides": {}}]}': "a job must have a name",
    '{"experiment": "e", "jobs": [{"name": "0", "overrides": {}}, {"name": "0", "overrides": {}}]}': "two jobs have",
}


@pytest.mark.parametrize("text", PLANS)
def test_a_plan_that_is_none_is_named(text, tmp_path):
    (tmp_path / "sweep.json").write_text(text)
    with pytest.raises(FileError, match=r"sweep\.json.*" + PLANS[text]):
        sweeps.sweeps_in([str(tmp_path)])


def test_directories_that_hold_no_sweep_are_refused(tmp_path):
    for names, message in (([], "name the directories"), (["nowhere"], "there is no directory nowhere"),
                           ([str(tmp_path)], "is no sweep and no folder of sweeps")):  # fmt: skip
        with pytest.raises(ConfigError, match=message):
            sweeps.sweeps_in(names)
