"""Sweeps put together: nothing is lost, nothing is counted twice, and what is said of them is true."""

import itertools
import json

import numpy as np
import pyarrow.parquet
import pytest

from experiments.collect import best, responses, scores, sensitivity, sweeps, tables
from experiments.collect.axes import short_labels
from experiments.collect.report import write_sweep
from experiments.collect.scores import Evidence, SweepScore
from experiments.collect.study import CollectStudy
from tests.experiments import sweeps as made
from tests.experiments.sweeps import GAP, GRID, OBSTACLE, TAU, collect, read, rising, rows_of
from urbanjax.io.runs.parameter_file import read_parameters
from urbanjax.types import ConfigError


@pytest.fixture(scope="module")
def grid(tmp_path_factory):
    """A grid of nine jobs, one of which failed and one of which is missing; collected into its own directory."""
    folder = made.plan(tmp_path_factory.mktemp("sweeps") / "grid", GRID)
    for number, values in enumerate(GRID):
        if number not in (4, 7):
            made.job(folder, number, rows=made.drives(rising(values)), summary={"drives": 16, "run_s": 1.5})
    made.job(folder, 4, status="failed", error="ScenarioError: the scene is empty")
    return folder, write_sweep(folder)


def test_every_planned_job_has_a_row_and_none_that_failed_is_dropped(grid):
    folder, counted = grid
    assert (counted.expected, counted.complete, counted.failed, counted.missing, counted.duplicates) == (9, 7, 1, 1, 0)
    assert not counted.whole
    rows = rows_of(folder / "table.csv")
    assert [row["status"] for row in rows] == ["complete"] * 4 + ["failed"] + ["complete"] * 2 + ["missing", "complete"]
    assert [(float(row[TAU]), int(row[OBSTACLE])) for row in rows] == [tuple(job.values()) for job in GRID]
    assert rows[4]["error"] == "ScenarioError: the scene is empty"
    assert rows[7]["error"] == "it has not begun"
    assert rows[0]["run_s"] == "1.5"
    again = pyarrow.parquet.read_table(folder / "table.parquet").to_pylist()
    assert [row[OBSTACLE] for row in again] == [job[OBSTACLE] for job in GRID]
    assert json.loads((folder / "manifest.json").read_text())["status"] == "failed"
    page = made.page(folder)
    assert "grid/00004" in page
    assert "the scene is empty" in page
    assert "9 jobs planned: 7 complete, 1 failed, 1 missing" in page
    assert 'src="data:image/png' in page
    assert "http" not in page.replace("http://www.w3.org", "")


def test_collecting_again_replaces_and_leaves_no_second_directory(grid):
    folder, _ = grid
    before = sorted(path.name for path in folder.parent.iterdir())
    table = (folder / "table.csv").read_bytes()
    assert write_sweep(folder).expected == 9
    assert sorted(path.name for path in folder.parent.iterdir()) == before
    assert (folder / "table.csv").read_bytes() == table


def test_the_best_job_is_a_parameter_file_that_comes_back_bit_for_bit(tmp_path):
    third = 1 / 3
    folder = made.sweep(tmp_path / "s", [{TAU: 0.1, GAP: 1.0}, {TAU: third, GAP: 0.1 + 0.2}], rising)
    write_sweep(folder)
    assert read_parameters(folder / "best.yaml") == {TAU: third, GAP: 0.1 + 0.2}
    text = (folder / "best.yaml").read_text()
    assert text.startswith("# sweep: s\n# job: 00001\n# score: nuplan_total 0.")
    assert "python -m experiments.evaluate params=" in text
    assert f"code: {made.CODE}" in text


def test_what_the_sweep_took_from_a_parameter_file_is_in_the_best_one_too(tmp_path):
    folder = made.sweep(tmp_path / "s", [{TAU: 0.0}, {TAU: 0.5}], rising, values=made.base(period=0.2))
    path = folder / "00001" / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest["config"] |= {"period": 0.1, "idm": {"time_gap": 2.5}, "seeds": 4}  # 0.1 is the default
    path.write_text(json.dumps(manifest))
    write_sweep(folder)
    assert read_parameters(folder / "best.yaml") == {"period": 0.1, TAU: 0.5, GAP: 2.5, "seeds": 4}


def test_values_are_those_of_the_loop_that_are_no_defaults_and_dotted_numbers():
    config = made.base(seeds=64)
    config["period"] = 0.2
    config["stack"] = {**config["stack"], "localizer": "${oc.env:WHICH}"}
    job = sweeps.SweepJob("s", "00000", None, "evaluate", "", {GAP: 2.0, "seed": 0, "missions": ["x"]}, config,
                          "complete", None, {}, "")  # fmt: skip
    assert best.values_of(job, config) == {"period": 0.2, GAP: 2.0}
    assert best.override("missions", ["a b", "c"]) == """'missions=["a b",c]'"""


def test_differences_are_of_the_same_drives_by_hand(grid):
    _, jobs, axes, evidence = read(grid[0])
    complete = [job for job in jobs if job.status == "complete"]
    points = responses.along(axes[0], axes, jobs=complete, evidence=evidence, name="nuplan_total")
    by_values = {(job.overrides[TAU], job.overrides[OBSTACLE]): job for job in complete}
    for point in points:
        less = [
            row["nuplan_total"] - other["nuplan_total"]
            for obstacle in (1, 2, 4)
            if (point.value, obstacle) in by_values
            for row, other in zip(made.drives(rising({TAU: point.value, OBSTACLE: obstacle})),
                                  made.drives(rising({TAU: 0.0, OBSTACLE: obstacle})), strict=True)
        ]  # fmt: skip
        assert point.pairs == len(less)
        assert point.less_first.value == pytest.approx(np.mean(less), abs=1e-12)
        assert point.less_first.low <= point.less_first.value <= point.less_first.high
    # What the start adds is the same in both: the difference is far surer than the means.
    last = points[-1]
    assert last.less_first.high - last.less_first.low < 0.2 * (last.score.high - last.score.low)


def test_drivers_are_compared_from_the_same_starts_though_their_drives_have_other_names(tmp_path):
    names = [{"drivers": [name]} for name in ("stack", "idm")]
    folder = made.plan(tmp_path / "s", names)
    for number, name in enumerate(("stack", "idm")):
        made.job(folder, number, rows=made.drives(0.7 - 0.1 * number, driver=name, noise=0.01))
    _, jobs, axes, evidence = read(folder)
    points = responses.along(axes[0], axes, jobs=jobs, evidence=evidence, name="nuplan_total")
    assert points[1].pairs == 16
    assert points[1].less_first.value == pytest.approx(-0.1)
    assert evidence.difference([(jobs[1], jobs[0])], "nuplan_total")[1] == 0


@pytest.mark.parametrize("signs", list(itertools.product((True, False), repeat=2)))
def test_the_front_is_what_trying_all_pairs_gives(signs, tmp_path):
    rng = np.random.default_rng(3)
    at = rng.integers(0, 12, (60, 2)) / 4
    folder = made.plan(tmp_path / "s", [{TAU: i} for i in range(60)])
    for number, (one, other) in enumerate(at.tolist()):
        made.job(folder, number, summary={"a": one, "b": other if number else None})
    _, jobs, _, evidence = read(folder)
    wanted = [SweepScore(name, more) for name, more in zip("ab", signs, strict=True)]
    value = at * [score.sign for score in wanted]
    expected = {
        i
        for i in range(1, 60)
        if not any((value[j] >= value[i]).all() and (value[j] > value[i]).any() for j in range(1, 60))
    }
    found = responses.front(jobs, evidence, scores=wanted)
    assert {int(job.name) for job in found} == expected


def test_an_axis_of_ten_times_the_weight_decides_ten_times_more(tmp_path):
    values = made.sampled({"x.a": (0.0, 1.0), "x.b": (0.0, 1.0), "x.c": (0.0, 1.0)}, 64)
    folder = made.plan(tmp_path / "s", values, kinds=dict.fromkeys(values[0], "lhs"))
    for number, each in enumerate(values):
        made.job(folder, number, summary={"y": each["x.a"] + 10 * each["x.b"], "flat": 1.0})
    _, jobs, axes, evidence = read(folder)
    state = np.random.get_state()[1].copy()  # noqa: NPY002
    found = sensitivity.indices(axes, jobs, evidence=evidence, name="y")
    assert (np.random.get_state()[1] == state).all()  # noqa: NPY002
    index = {each.axis.key: each for each in found}
    assert found[0].axis.key == "x.b"
    assert index["x.b"].first_order.value > 0.8
    assert index["x.a"].first_order.value < 0.3
    assert index["x.b"].delta.low > index["x.a"].delta.high
    assert sensitivity.indices(axes, jobs, evidence=evidence, name="flat") == []
    assert sensitivity.indices(axes, jobs[:29], evidence=evidence, name="y") == []
    bins = responses.binned(axes[1], jobs, evidence=evidence, name="y")
    assert sum(point.jobs for point in bins) == 64
    assert np.all(np.diff([point.score.value for point in bins]) > 0)


def test_a_report_outlives_the_library_of_indices(tmp_path, monkeypatch):
    values = made.sampled({"x.a": (0.0, 1.0)}, 32)
    folder = made.plan(tmp_path / "s", values, kinds={"x.a": "lhs"})
    for number, each in enumerate(values):
        made.job(folder, number, summary={"y": each["x.a"]})
    monkeypatch.setattr(sensitivity, "PROGRAM", "raise SystemExit('no such method')")
    run = collect(tmp_path / "run", folder, score="y")
    assert "There are no indices: SALib has failed: no such method." in made.page(run.directory)


def test_the_same_job_of_two_sweeps_counts_once(tmp_path):
    one = made.sweep(tmp_path / "all" / "one", [{TAU: 0.0}, {TAU: 0.5}], rising)
    two = made.plan(tmp_path / "all" / "two", [{TAU: 0.5}, {TAU: 1}])
    made.job(two, 1, rows=made.drives(0.7))
    other = made.sweep(tmp_path / "all" / "other", [{TAU: 0.5}], rising, code="of other sources")
    run = collect(tmp_path / "run", tmp_path / "all")
    summary = json.loads(run.path("summary.json").read_text())
    assert [summary[name] for name in ("expected", "complete", "missing", "duplicates")] == [4, 4, 0, 1]
    assert summary == json.loads(collect(tmp_path / "run2", one, two, one, other).path("summary.json").read_text())
    page = made.page(run.directory)
    assert "two/00000" in page
    assert "2 states of the code" in page


def test_what_sweeps_differ_in_is_an_axis_too(tmp_path):
    for mission in made.MISSIONS:
        rows = lambda score, mission=mission: made.drives(score, missions=[mission])  # noqa: E731
        made.sweep(tmp_path / mission, [{TAU: 0.0}, {TAU: 1.0}], rising, rows=rows,
                   values=made.base(missions=[mission]))  # fmt: skip
    _, _, axes, _ = read(tmp_path)
    found = [(axis.key, axis.kind, len(axis.values)) for axis in axes]
    assert found == [(TAU, "choice", 2), ("missions", "between sweeps", 2)]


def test_two_experiments_are_told_apart_and_both_are_there(tmp_path):
    made.sweep(tmp_path / "s" / "a", [{TAU: 0.0}, {TAU: 1.0}], rising)
    other = made.plan(tmp_path / "s" / "b", [{"taus": [0.0]}, {"taus": [1.0]}], experiment="overtake")
    for number in range(2):
        entries = {"progress_m": 200.0 + number, "progress_m_low": 190.0, "progress_m_high": 210.0}
        made.job(other, number, summary=entries)
    run = collect(tmp_path / "run", tmp_path / "s")
    assert [row["experiment"] for row in rows_of(run.path("table.csv"))] == ["evaluate"] * 2 + ["overtake"] * 2
    assert read_parameters(run.path("evaluate_best.yaml")) == {TAU: 1.0}
    page = made.page(run.directory)
    assert "What came out (overtake)" in page
    assert "b/00001 with 201" in page


def test_scores_are_found_or_refused_by_name(tmp_path):
    folder = made.sweep(tmp_path / "s", [{TAU: 0.0}, {TAU: 1.0}], rising)
    _, jobs, _, _ = read(folder)
    assert [each.name for each in scores.chosen(CollectStudy(), jobs)] == ["nuplan_total", "success"]
    least = scores.chosen(CollectStudy(score="competition_time", best="least", against="-"), jobs)
    assert least == [SweepScore("competition_time", False)]
    assert scores.ranked(jobs, Evidence(jobs, ["competition_time"]), least[0])[0].overrides == {TAU: 1.0}
    with pytest.raises(
        ConfigError, match="score=nuplan: no job has such a score; the nearest valid key is 'nuplan_total'"
    ):
        scores.chosen(CollectStudy(score="nuplan"), jobs)


def test_long_keys_get_the_shortest_names_that_tell_them_apart():
    keys = ["stack.a.weights.obstacle", "stack.b.weights.obstacle", TAU, "seeds"]
    assert list(short_labels(keys).values()) == ["a.weights.obstacle", "b.weights.obstacle", "tau", "seeds"]
    assert short_labels(["a.b", "b"]) == {"a.b": "a.b", "b": "b"}


def test_scales_are_those_of_the_values(tmp_path):
    values = made.product({TAU: [0.0, 0.5], OBSTACLE: [1, 2, 4], GAP: [1.0, 1.5, 2.0], "x.y": [True, False]})
    _, _, axes, _ = read(made.plan(tmp_path / "s", values))
    assert [(axis.numeric, axis.log) for axis in axes] == [(True, False), (True, True), (True, False), (False, False)]


def test_numbers_are_shown_in_the_digits_that_their_intervals_allow():
    values = ((0.61234, 0.5, 0.7), (201.23, 190, 210), (1, np.nan, np.nan))
    found = [tables.text(scores.WithInterval(*value)) for value in values]
    assert found == ["0.612 [0.500, 0.700]", "201.2 [190.0, 210.0]", "1.00"]
