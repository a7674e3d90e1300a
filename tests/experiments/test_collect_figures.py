"""Figures of sweeps: ticks that are numbers, colours and intervals that stay in range, points that are shared."""

import json

import numpy as np
import pytest
from matplotlib.figure import Figure

from experiments.collect import figures, figures_of_many, responses, sensitivity, ticks
from experiments.collect.axes import axes_of
from experiments.collect.report import write_sweep
from tests.experiments import sweeps as made
from tests.experiments.sweeps import GAP, OBSTACLE, TAU, read
from urbanjax.evaluation.statistics import WithInterval


def axis_of(folder, values, key=TAU, **kind):
    """The axis of some values. Args: folder; values; key; kind, of the plan."""
    plans, jobs, _, _ = read(made.plan(folder / "axis", [{key: value} for value in values], kinds={key: kind}))
    return axes_of(plans, jobs)[0]


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (0.3, 4.0, [0.3, 1, 3]),
        (0.31, 3.9, [0.5, 1, 2]),
        (1.0, 2.0, [1, 1.5, 2]),
        (0.001, 1000.0, [0.001, 0.01, 0.1, 1, 10, 100, 1000]),
        (1.1, 1.2, [1.1, 1.2]),
        (2.0, 2.0, [2.0]),
    ],
)
def test_ticks_of_a_logarithmic_axis_are_round_numbers_within_it(low, high, expected):
    assert ticks.log_ticks(low, high) == pytest.approx(expected)


@pytest.mark.parametrize("low", 10.0 ** np.linspace(-9, 3, 7) * 1.7)
@pytest.mark.parametrize("ratio", [1.01, 3.0, 40.0, 1e4, 1e15])
def test_ticks_of_a_logarithmic_axis_are_few_and_never_past_it(low, ratio):
    found = ticks.log_ticks(low, low * ratio)
    assert 2 <= len(found) <= 7
    assert low * (1 - 1e-8) <= min(found) <= max(found) <= low * ratio * (1 + 1e-8)


def test_labels_of_a_logarithmic_axis_are_plain_and_there_are_no_others(tmp_path):
    axis = axis_of(tmp_path, [0.4, 2.0, 3.5], GAP, kind="sobol", log=True, low=0.3, high=4.0)
    panels = list(Figure().subplots(2, 1, sharex=True))
    ticks.scale(panels, axis)
    for panel in panels:
        assert panel.get_xscale() == "log"
        assert list(panel.xaxis.get_minorticklocs()) == []
    assert [label.get_text() for label in panels[-1].get_xticklabels()] == ["0.3", "1", "3"]
    assert [panel.get_xlabel() for panel in panels] == ["", "time_gap"]


def test_of_few_values_only_these_are_marked_in_every_panel(tmp_path):
    panels = list(Figure().subplots(2, 1, sharex=True))
    ticks.scale(panels, axis_of(tmp_path, [1, 2, 4], OBSTACLE, kind="choice"))
    for panel in panels:
        assert list(panel.xaxis.get_majorticklocs()) == [1, 2, 4]
        assert list(panel.xaxis.get_minorticklocs()) == []


def test_rows_of_a_heat_map_are_all_labelled_or_at_even_steps(tmp_path):
    nine = axis_of(tmp_path, np.linspace(0, 1, 9).tolist())
    assert list(ticks.marked(nine, figures_of_many.ROWS)) == list(range(9))
    many = axis_of(tmp_path, np.linspace(0, 1, 30).tolist())
    at = list(ticks.marked(many, figures_of_many.ROWS))
    assert len(at) <= figures_of_many.ROWS
    assert len(set(np.diff(at))) == 1
    assert ticks.room_across(nine) == 6  # of labels as long as 0.125


def test_colours_of_a_share_stay_within_0_and_1_where_all_are_equal():
    for value in (0.0, 0.7, 1.0):
        norm = figures_of_many._shades(value, value, "success").norm
        assert (norm.vmin, norm.vmax) == (0.0, 1.0)
    norm = figures_of_many._shades(20.0, 20.0, "competition_total").norm
    assert norm.vmin < 20.0 < norm.vmax
    norm = figures_of_many._shades(0.2, 0.4, "success").norm
    assert (norm.vmin, norm.vmax) == (0.2, 0.4)


def test_an_interval_of_an_index_is_cut_to_what_the_index_can_be():
    assert sensitivity._within(0.07, 0.09) == pytest.approx((0.07, 0.0, 0.16))
    assert sensitivity._within(0.95, 0.2) == pytest.approx((0.95, 0.75, 1.0))
    assert sensitivity._within(0.5, 0.1) == pytest.approx((0.5, 0.4, 0.6))


def test_a_constant_score_has_no_index_and_no_front_and_the_page_says_so(tmp_path):
    values = made.sampled({GAP: (1.0, 2.0), TAU: (0.0, 1.0)}, 32)
    made.sweep(tmp_path / "s", values, lambda job: 0.1 + 0.1 * job[GAP], kinds=dict.fromkeys(values[0], "lhs"))
    write_sweep(tmp_path / "s")
    page = made.page(tmp_path / "s")
    assert "success is left out: it is the same in all jobs." in page
    assert "There is no front: success is the same in all jobs." in page
    assert not (tmp_path / "s" / "front.png").exists()


def test_jobs_at_one_point_are_counted_and_one_job_is_no_jobs(tmp_path):
    exact = lambda *values: [WithInterval(value, value - 0.1, value + 0.1) for value in values]  # noqa: E731
    nothing = [WithInterval(np.nan, np.nan, np.nan), WithInterval(1.0, 1.0, 1.0)]
    pairs = [exact(0.5, 1.0), exact(0.5 + 1e-12, 1.0), exact(0.5, 0.9), nothing]
    assert dict(figures_of_many.coinciding(pairs)) == {(0.5, 1.0): 2, (0.5, 0.9): 1}
    assert len(figures_of_many._points(pairs)) == 2
    made.sweep(tmp_path / "s", [{GAP: 1.0}, {GAP: 3.0}], lambda job: 0.25 * job[GAP])
    write_sweep(tmp_path / "s")
    assert "The job on the front" in made.page(tmp_path / "s")


def test_jobs_of_a_sample_are_points_and_only_means_have_whiskers(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(figures, "whiskers", lambda axes, at, scores, **how: drawn.append((len(scores), how["label"])))
    axis = axis_of(tmp_path, [0.1, 0.2, 0.3], kind="sobol")
    scores = [WithInterval(0.5, 0.1, 0.9)] * 3
    point = responses.ResponsePoint(0.2, 3, WithInterval(0.5, 0.4, 0.6), scores[0], 0)
    found = {"success": (np.array([0.1, 0.2, 0.3]), scores)}
    figures.draw_sample(axis, found, {"success": [point] * 2}, tmp_path / "a.png")
    assert drawn == [(2, "means of bins")]


def test_the_page_tells_when_jobs_ran_and_when_it_was_written(tmp_path):
    folder = made.sweep(tmp_path / "s", [{TAU: 0.0}, {TAU: 0.5}, {TAU: 1.0}], made.rising)
    for number, (second, lasted) in enumerate(((0, 30.0), (10, 30.0))):  # at once; the third one tells nothing
        path = folder / f"{number:05d}" / "manifest.json"
        times = {"started": f"2026-11-30T10:43:{second:02d}+0000", "wall_time_s": lasted}
        path.write_text(json.dumps(json.loads(path.read_text()) | times))
    write_sweep(folder)
    page = made.page(folder)
    assert 'first job started</td><td class="words fact">2026-11-30T10:43:00+0000' in page
    told = "40 s on the clock; in sum, where jobs at once each count in full, 60 s (known of 2 of 3 jobs)"
    assert told in page
    for name in ("report begun", "time to write it", "git commit of the report", "sources (hash)"):
        assert page.count(name) == 1
    for name in ("<td>started</td>", "<td>wall time</td>", "<td>code</td>", ">code</th>"):
        assert name not in page
