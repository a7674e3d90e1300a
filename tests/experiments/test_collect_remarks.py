"""What the report says beside the best job: ties, edges, scores that tell nothing apart, intervals of few drives."""

import pytest

from experiments.collect import remarks, tables
from experiments.collect.axes import axes_of
from experiments.collect.collected import collected
from experiments.collect.report import write_sweep
from experiments.collect.study import CollectStudy
from tests.experiments import sweeps as made
from tests.experiments.sweeps import GAP, OBSTACLE, TAU, read
from urbanjax.io.runs.sweeps import plan as plans_of
from urbanjax.io.runs.sweeps.axes import axes_of as asked_axes
from urbanjax.io.runs.sweeps.axes import jobs_of as asked_jobs

HEADWAY = "stack.behavior.headway.time_headway"


def part_of(folder, **asked):
    plans, jobs, axes, _ = read(folder)
    return collected(CollectStudy(**asked), plans, jobs, axes, alone=True)


def swept(folder, values, answer, **more):
    made.sweep(folder, values, answer, **more)
    return part_of(folder)


def test_jobs_that_are_as_good_as_the_best_are_named(tmp_path):
    values = made.product({GAP: [1.0, 2.0, 3.0], OBSTACLE: [1, 2]})
    part = swept(tmp_path / "s", values, lambda job: 0.9 if job[GAP] == 2.0 else 0.3)
    assert remarks.ties(part) == ["It is tied with 1 other: s/00003."]
    part = swept(tmp_path / "t", values, lambda job: 0.4 if job[GAP] == 2.0 else 0.3 + 0.01 * job[OBSTACLE])
    assert remarks.ties(part) == ["It is tied with 1 other: t/00003."]
    part = swept(tmp_path / "u", values, lambda job: 0.1 * job[GAP] + 0.01 * job[OBSTACLE])
    assert remarks.ties(part) == []


def test_the_second_best_is_not_one_that_is_as_good(tmp_path):
    values = made.product({GAP: [1.0, 2.0, 3.0], OBSTACLE: [1, 2]})
    made.sweep(tmp_path / "s", values, lambda job: 0.3 + 0.1 * job[GAP])
    write_sweep(tmp_path / "s")
    assert ">s/00002</td>" in made.page(tmp_path / "s").split("second best")[1].split("</tr>")[0]


@pytest.mark.parametrize(
    ("best", "expected"),
    [
        (1.0, "The best of time_gap is the least value asked, 1: the optimum may lie beyond."),
        (2.0, ""),
        (3.0, "The best of time_gap is the greatest value asked, 3: the optimum may lie beyond."),
    ],
)
def test_a_best_value_at_the_edge_of_what_was_asked_is_told(best, expected, tmp_path):
    values = made.product({GAP: [1.0, 2.0, 3.0], OBSTACLE: [1, 2]})
    part = swept(tmp_path / "s", values, lambda job: 0.9 if job[GAP] == best else 0.3)
    assert remarks.edges(part) == [expected] * bool(expected)  # of the other axis both values are as good


def test_nothing_is_beyond_what_a_value_may_be(tmp_path):
    part = swept(tmp_path / "s", [{TAU: tau} for tau in (0.0, 0.5, 1.0)], lambda job: 0.2 + 0.5 * job[TAU])
    assert remarks.edges(part) == ["The best of tau is the greatest value asked, 1, and the most that it may be."]


def test_a_seed_has_no_edge(tmp_path):
    part = swept(tmp_path / "s", [{"seed": seed} for seed in (0, 1, 2)], lambda job: 0.2 + 0.1 * job["seed"])
    assert remarks.edges(part) == []


def test_of_a_sample_the_edge_is_the_last_value_drawn(tmp_path):
    values = [{GAP: gap} for gap in (1.3, 2.2, 1.7)]
    part = swept(tmp_path / "s", values, lambda job: 0.2 * job[GAP], kinds={GAP: "sobol"})
    assert remarks.edges(part) == ["The best of time_gap is the greatest value drawn, 2.2: the optimum may lie beyond."]


def test_what_is_the_same_in_all_jobs_is_told_and_so_is_that_nobody_succeeds(tmp_path):
    low = swept(tmp_path / "low", [{GAP: 1.0}, {GAP: 2.0}], lambda job: 0.1 * job[GAP])
    same = "success is {} in all jobs that have it, so it tells none of them apart."
    assert remarks.constants(low) == ["No drive of the whole sweep succeeded.", same.format(0)]
    alone = part_of(tmp_path / "low", score="competition_time", best="least", against="-")
    assert remarks.constants(alone) == ["No drive of the whole sweep succeeded."]
    high = swept(tmp_path / "high", [{GAP: 1.0}, {GAP: 2.0}], lambda job: 0.8 + 0.01 * job[GAP])
    assert remarks.constants(high) == [same.format(1)]
    mixed = swept(tmp_path / "mixed", [{GAP: 1.0}, {GAP: 9.0}], lambda job: 0.1 * job[GAP])
    assert remarks.constants(mixed) == []


def test_intervals_of_few_drives_are_told_with_their_number(tmp_path):
    few = swept(
        tmp_path / "few",
        [{GAP: 1.0}, {GAP: 2.0}],
        lambda job: 0.1 * job[GAP],
        rows=lambda score: made.drives(score, seeds=2),
    )
    assert remarks.few(few) == [
        "Intervals and differences are from few pairs of drives (4 of each job, in 4 scenes), and the best of 2 is "
        "picked by these same drives (winner's curse): drive the best one again with other seeds."
    ]
    assert remarks.of_drives(few, few.ranking[0]) == " over 4 drives in 4 scenes"
    many = swept(tmp_path / "many", [{GAP: 1.0}, {GAP: 2.0}], lambda job: 0.1 * job[GAP])
    assert remarks.few(many) == []
    write_sweep(tmp_path / "few")
    page = made.page(tmp_path / "few")
    for text in (
        "over 4 drives in 4 scenes",
        "winner&#39;s curse",
        "nuPlan&#39;s closed-loop score",
        "No drive of the",
    ):
        assert page.count(text) == 1


def test_the_range_asked_for_is_shown_and_not_the_sample_of_it(tmp_path):
    asked = asked_axes({HEADWAY: ["sobol:0.8:2.5:8"], OBSTACLE: ["sobol:0.3:4:8:log"], GAP: [1.0, 2.0]})
    jobs = asked_jobs(asked)
    planned = plans_of.plan_of("evaluate", made.base(), axes=asked, jobs=jobs, contents=jobs)
    (tmp_path / "s").mkdir()
    planned.write(tmp_path / "s")
    plans, found, axes, _ = read(tmp_path / "s")
    assert [axis.ends for axis in axes] == [(0.8, 2.5), (0.3, 4.0), (1.0, 2.0)]
    assert tables.asked(plans, axes)[1]["from, to, or which"] == ["0.8 to 2.5", "0.3 to 4", "1 to 2"]
    for axis in plans[0].axes.values():  # as plans were written before
        axis.pop("low", None)
    older = axes_of(plans, found)
    assert older[0].ends == (min(job[HEADWAY] for job in jobs), max(job[HEADWAY] for job in jobs))
    assert tables.asked(plans, older)[1]["from, to, or which"][0].endswith(" (those drawn)")


def test_a_range_of_two_sweeps_holds_both_and_is_not_known_where_one_is_not(tmp_path):
    first = {"kind": "sobol", "low": 0.0, "high": 1.0}
    others = {"a": {"kind": "sobol", "low": 0.5, "high": 3.0}, "b": "sobol"}
    for name, kind in others.items():
        one = made.plan(tmp_path / name / "one", [{GAP: 0.2}, {GAP: 0.7}], kinds={GAP: first})
        two = made.plan(tmp_path / name / "two", [{GAP: 0.9}, {GAP: 2.0}], kinds={GAP: kind})
        _, _, axes, _ = read(one, two)
        assert axes[0].ends == {"a": (0.0, 3.0), "b": (0.2, 2.0)}[name]


def test_axes_have_the_units_of_their_fields(tmp_path):
    _, _, axes, _ = read(made.plan(tmp_path / "s", [{HEADWAY: 1.0, TAU: 0.5, OBSTACLE: 1, "seeds": 4}]))
    assert [axis.title for axis in axes] == ["time_headway [s]", "tau", "obstacle", "seeds"]
    assert axes[2].unit.startswith("per m^2 of ")  # too long for a figure, not for the table
