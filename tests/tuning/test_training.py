"""The loop of tuning, on losses that are known: what it finds, when it ends, and that a cut changes nothing."""

import types
from typing import ClassVar

import numpy as np
import pytest

from urbanjax.evaluation.scores import ScoreParams
from urbanjax.rollout import LoopParams
from urbanjax.tuning import Training, TrainingParams, space
from urbanjax.tuning import training as module
from urbanjax.tuning.losses.closed_loop import Rows
from urbanjax.tuning.scenes import TuningScene
from urbanjax.tuning.starts import SceneSet
from urbanjax.types import ConfigError
from urbanjax.types.errors import NotFiniteError, TuningError

SPACE = space(LoopParams(), ["stack.behavior.gvp.tau", "stack.planning.micro.weights.macro"])
BEST = np.array([0.4, -0.3])


class Moved:
    """In the place of starts: by how much each scene's best point is moved."""

    loop = types.SimpleNamespace(period=np.array([0.1]))

    def __init__(self, case):
        self.case = case

    def at(self, chosen):
        return Moved(self.case[chosen])


def scene_set(count, *, offset=0.0):
    """Scenes whose loss is a parabola around BEST, moved by their own amount."""
    moved = Moved(offset + 0.01 * np.arange(count))
    return SceneSet(tuple(TuningScene("overtake", k, "idm", 0.0) for k in range(count)), moved)


class Known:
    """In the place of a closed loop; `asked` records horizons, `scenes` which, `spoilt` ones give no number."""

    asked: ClassVar[list] = []
    scenes: ClassVar[list] = []
    spoilt: tuple = ()
    against = 1.0

    def __init__(self, space, longest, step_clip):
        self.longest = longest

    def losses(self, z, start, *, n_steps, score, relaxation, derivative):
        z = np.asarray(z)
        Known.asked.append((n_steps, relaxation.mode, float(relaxation.temperature), len(z)))
        Known.scenes.append(set(np.unique(start.case).tolist()))
        weight = np.array([one.progress for one in score]) if score is not None else np.ones(len(z))
        away = z - BEST * weight[:, None] - start.case[:, None]
        loss = (away**2).sum(1)
        gradient = Known.against * 2 * away if derivative != "none" else away[:, :0]
        loss = np.where(np.isin(np.round(start.case, 3), Known.spoilt), np.nan, loss)
        return Rows(loss, None, gradient)


@pytest.fixture(autouse=True)
def _known(monkeypatch):
    monkeypatch.setattr(module, "ClosedLoop", Known)
    Known.asked, Known.scenes, Known.spoilt, Known.against = [], [], (), 1.0


def search(*, state=None, scores=None, **changes):
    settings = {"generations": 40, "scenes": 4, "rate": 0.1, "scene_clip": 10.0, "clip": 10.0, "patience": 100}
    params = TrainingParams(**{**settings, **changes})
    learned, judged = scene_set(12), scene_set(6, offset=0.02)
    return Training(SPACE, params, learned=learned, judged=judged, state=state, scores=scores)


def test_the_best_point_is_near_the_known_one_and_judged_by_other_scenes():
    found = search()
    list(found.run())
    z, losses = found.best
    np.testing.assert_allclose(z, BEST + 0.045, atol=0.05)
    assert len(losses) == 6
    assert losses.mean() < found.first.mean() / 10
    assert {mode for _, mode, _, _ in Known.asked} == {"hard", "soft"}


@pytest.mark.parametrize("optimiser", ["cma_es", "random", "tpe"])
def test_a_search_without_gradient_asks_hard_losses_alone(optimiser):
    found = search(optimiser=optimiser, generations=30, sigma=0.5)
    list(found.run())
    assert {mode for _, mode, _, _ in Known.asked} == {"hard"}
    assert found.best[1].mean() < found.first.mean()
    assert found.cost_of_gradient() == 1.0


@pytest.mark.parametrize("optimiser", ["gradient", "cma_es"])
@pytest.mark.parametrize("cut", [1, 6, 11])
def test_a_search_that_was_cut_off_goes_on_bit_for_bit(optimiser, cut):
    whole, part = (search(optimiser=optimiser, restarts=2) for _ in range(2))
    list(whole.run())
    going = part.run()
    for _ in range(cut):
        next(going)
    again = search(optimiser=optimiser, restarts=2, state=part.state())
    list(again.run())
    for name, value in whole.state().items():
        np.testing.assert_array_equal(again.state()[name], value, err_msg=name)


def test_it_ends_when_nothing_gets_better():
    Known.against = -1.0
    found = search(patience=2, every=2)
    list(found.run())
    assert found.generation == 4
    np.testing.assert_array_equal(found.best[0], np.zeros(2))


def test_the_horizon_grows_while_gradients_hold_and_only_then():
    list(search(horizons=(1.0, 2.0, 3.0), every=5).run())
    asked = [n for n, mode, _, count in Known.asked if mode == "soft" and count == 4]
    assert asked[:5] == [10] * 5
    assert sorted(set(asked)) == [10, 20, 30]
    Known.asked, Known.against = [], -1.0
    held = search(horizons=(1.0, 2.0, 3.0), every=5)
    list(held.run())
    assert held.horizon == 0
    assert all(check.cosine < -0.9 for check in held.checks[1:])


def test_temperatures_go_from_the_first_to_the_last():
    list(search(temperatures=(0.2, 0.05), generations=11).run())
    asked = [t for _, mode, t, _ in Known.asked if mode == "soft"]
    assert asked[0] == pytest.approx(0.2)
    assert asked[-1] == pytest.approx(0.05)
    ratios = np.array(asked[1:]) / np.array(asked[:-1])
    assert ratios.std() < 1e-6 or np.all(ratios <= 1)


def test_every_restart_minimises_a_score_of_its_own():
    scores = [ScoreParams(progress=p) for p in (0.5, 1.0, 2.0)]
    found = search(scores=scores, generations=60)
    list(found.run())
    final = found.checks[-1].z
    np.testing.assert_allclose(final, np.outer([0.5, 1.0, 2.0], BEST) + 0.055, atol=0.08)


@pytest.mark.parametrize(
    ("optimiser", "anew"), [("gradient", True), ("cma_es", True), ("tpe", False), ("random", False)]
)
def test_scenes_are_drawn_anew_where_generations_are_not_compared(optimiser, anew):
    found = search(optimiser=optimiser)
    for _ in range(4):
        found.learn()
    first, *others = Known.scenes
    assert len(first) == 4
    assert all(there == first for there in others) != anew


def test_a_front_ends_with_the_last_of_its_searches():
    there, far = ScoreParams(progress=0.0), ScoreParams(progress=4.0)
    asked = {"generations": 40, "patience": 2, "every": 2}
    alone = search(scores=[there], **asked)
    list(alone.run())
    both = search(scores=[there, far], **asked)
    list(both.run())
    assert alone.generation < 30
    assert both.generation == 40


def test_risk_follows_the_worst_scenes():
    mean, worst = search(generations=80, scenes=12), search(generations=80, scenes=12, risk=0.1)
    for one in (mean, worst):
        list(one.run())
    spread = (scene_set(12).start.case.min() + scene_set(12).start.case.max()) / 2
    np.testing.assert_allclose(worst.checks[-1].z[0], BEST + spread, atol=0.03)


def test_what_is_no_number_is_named_and_what_came_before_is_kept():
    found = search()
    going = found.run()
    for _ in range(3):
        next(going)
    kept = found.state()
    Known.spoilt = tuple(np.round(scene_set(12).start.case, 3))
    with pytest.raises(NotFiniteError, match=r"generation 2: the loss is not finite in the scene overtake, seed \d+"):
        list(going)
    for name, value in kept.items():
        np.testing.assert_array_equal(found.state()[name], value)


def test_a_derivative_that_is_no_number_names_its_parameter():
    Known.against = np.array([1.0, np.inf])
    with pytest.raises(NotFiniteError, match="with respect to") as told:
        list(search().run())
    assert told.value.parameter == SPACE.keys[1]


def test_settings_that_exclude_each_other_are_refused():
    with pytest.raises(TuningError, match="one score at a time"):
        search(optimiser="cma_es", scores=[ScoreParams()] * 2)
    with pytest.raises(ConfigError, match="each longer"):
        search(horizons=(2.0, 1.0))
    with pytest.raises(TuningError, match="lacks"):
        search(state={"marks": np.zeros(1)})
