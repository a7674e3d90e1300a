"""Fronts, and searches at equal cost: what is made of drives and searches that are made up."""

import numpy as np
import pytest

from experiments.tune import budget, pareto
from experiments.tune.budget import BudgetCurve
from experiments.tune.pareto import FrontPoint
from experiments.tune.study import BudgetParams, ParetoParams
from experiments.tune.tested import HeldBackDrives, difference, table, worse
from urbanjax.evaluation.scores import ScoreParams
from urbanjax.evaluation.statistics import WithInterval


def point(name, speed, comfort):
    exact = [WithInterval(value, value - 0.1, value + 0.1) for value in (speed, comfort)]
    share, both = WithInterval(0.0, 0.0, 1.0), dict(zip(pareto.OBJECTIVES, exact, strict=True))
    return FrontPoint(name, both, dict.fromkeys(pareto.GUARDED, share), both, share)


def test_whoever_is_beaten_in_both_is_not_on_the_front():
    found = [point("a", 1.0, -0.5), point("b", 0.8, -0.2), point("c", 0.7, -0.3), point("d", 1.0, -0.6)]
    assert pareto.on_front(found) == [True, True, False, False]
    assert pareto.on_front([point("a", 1.0, 0.0)] * 3) == [True, False, False]
    assert pareto.on_front([point("a", 1.0, -0.5), point("b", 1.0, -0.4)] * 2) == [False, True, False, False]


def test_preferences_are_a_geometric_series_around_the_standard_score():
    found = pareto.preferences(ParetoParams(points=5, least=0.25, most=4.0), ScoreParams())
    assert [ratio for ratio, _ in found] == pytest.approx([0.25, 0.5, 1.0, 2.0, 4.0])
    standard = ScoreParams()
    assert found[2][1] == standard
    for ratio, score in found:
        for term in pareto.OBJECTIVES["comfort"]:
            asked = getattr(score, term) * standard.progress
            assert asked == pytest.approx(ratio * getattr(standard, term) * score.progress)
        for term in pareto.GUARDED["room"]:
            assert getattr(score, term) == getattr(standard, term)


def test_a_front_is_drawn(tmp_path):
    groups = {
        pareto.TUNED: [point("comfort x 1", 1.0, -0.35), point("comfort x 2", 0.8, -0.4)],
        pareto.TAUS: [point("tau 0", 0.8, -0.3)],
        pareto.BEFORE: [point(pareto.BEFORE, 0.9, -0.4)],
    }
    pareto.draw(groups, groups[pareto.TUNED][:1], tmp_path / "front.png")
    assert (tmp_path / "front.png").stat().st_size > 10_000


def curve(optimiser, restart, scores, apart=20.0):
    cost = apart * np.arange(len(scores))
    return BudgetCurve(optimiser, restart, cost, cost / 10, np.array(scores))


CURVES = [
    curve("gradient", 0, [0.1, 0.35, 0.5, 0.5]),
    curve("gradient", 1, [0.1, 0.2, 0.25, 0.3]),
    curve("cma_es", 0, [0.1, 0.2, 0.25, 0.3]),
    curve("cma_es", 1, [0.1, 0.2, 0.3, 0.4]),
    curve("tpe", 0, [0.1, 0.1, 0.2, 0.2]),
    curve("tpe", 1, [0.1, 0.1, 0.2, 0.45]),
]


def test_cost_and_seconds_up_to_a_score():
    assert budget.reached(CURVES[0], 0.3) == (20.0, 2.0)
    assert budget.reached(CURVES[0], 0.6) == (np.inf, np.inf)


def test_searches_are_held_against_the_better_of_the_others():
    asked = BudgetParams(optimisers=("gradient", "cma_es", "tpe"), restarts=2)
    found = budget._table(CURVES, asked)
    assert found["as good as the better of CMA-ES and TPE"] == ["1 of 2", "1 of 2", "1 of 2"]
    assert found["restarts"] == [2, 2, 2]
    assert budget._summary(CURVES, asked)["gradient_last_score"] == pytest.approx(0.4)


def test_curves_are_drawn(tmp_path):
    budget.draw(CURVES, tmp_path / "budget.png")
    assert (tmp_path / "budget.png").stat().st_size > 20_000


def row(seed, score, fault=False):
    told = {"nuplan_total": score, "success": not fault, "competition_at_fault": fault, "competition_off_road": False}
    about = {"mission": "cut_in", "seed": seed, "traffic": "idm", "localization": "given"}
    return {**about, **told, "score": score, "mean_speed": 10 * score}


TESTED = HeldBackDrives(
    ("before", "tuned"),
    {
        "before": [row(k, 0.5, fault=k == 3) for k in range(8)],
        "tuned": [row(k, 0.6 if k != 5 else 0.2) for k in range(8)],
    },
)


def test_tested_sets_are_paired():
    shown = table(TESTED)
    first = shown["measure"].index("score that was tuned")
    assert shown["tuned - before"][first].startswith("0.050 [")
    assert difference(TESTED.rows, "tuned", "competition_at_fault", first="before").value == pytest.approx(-12.5)
    assert [after["seed"] for _, after in worse(TESTED, "tuned", 3)] == [5]
