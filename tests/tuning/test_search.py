"""The protocol that all searches share: budgets, failures, repeats and replays."""

import io
import itertools
import sys

import jax
import numpy as np
import pytest

from tests.tuning.searches import KINDS, MULTIPLE, made, searched, sphere, sphere_and_gradient
from urbanjax.tuning import CmaEs, GradientDescent, RandomSearch, Tpe, minimise, replayed
from urbanjax.types.errors import GradientError, TuningError

LIBRARIES = [(CmaEs, "cmaes"), (Tpe, "optuna"), (GradientDescent, "optax")]


def cost(kind):
    return MULTIPLE if kind.needs_gradient else 1.0


@pytest.mark.parametrize("kind", KINDS)
def test_the_budget_is_kept_exactly(kind):
    optimiser, asked = made(kind), []

    def evaluate(z):
        asked.append(len(z))
        return sphere_and_gradient(z) if kind.needs_gradient else sphere(z)

    records = searched(optimiser, evaluate, budget=40 * cost(kind) + 0.5)
    assert sum(asked) == optimiser.evaluations == records[-1].evaluations == 40
    assert [record.evaluations for record in records] == np.cumsum(asked).tolist()
    assert [record.cost for record in records] == [cost(kind) * record.evaluations for record in records]
    assert all(later.best_loss <= one.best_loss for one, later in itertools.pairwise(records))
    assert all(later.seconds >= one.seconds > 0 for one, later in itertools.pairwise(records))
    assert records[-1].best_loss == optimiser.history()["losses"].min()


def test_a_cost_that_is_no_binary_fraction_buys_what_it_should():
    records = list(minimise(sphere_and_gradient, made(GradientDescent), budget=3.3, cost_of_gradient=1.1))
    assert records[-1].evaluations == 3  # 3.3 / 1.1 is less than 3


def test_whoever_has_seen_enough_stops():
    optimiser = made(RandomSearch)
    next(minimise(sphere, optimiser, budget=10**9))
    assert optimiser.evaluations == 16


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_says_all(kind):
    def points(seed):
        np.random.seed(seed + 7)  # noqa: NPY002 - the generator that all share must not matter
        optimiser = made(kind, seed=seed, **({"restarts": 2} if kind is GradientDescent else {}))
        searched(optimiser, budget=40 * cost(kind))
        return optimiser.history()["z"]

    np.testing.assert_array_equal(points(3), points(3))
    assert (points(3)[1:] != points(4)[1:]).any(axis=1).mean() > 0.4


@pytest.mark.parametrize("kind", KINDS)
def test_a_search_that_was_cut_off_goes_on_as_if_it_had_not_been(kind):
    """Also where it ended within a generation, and some of its losses were not finite."""

    def evaluate(z):
        losses = np.where(z[:, 0] > 1.5, np.nan, sphere(z))
        return (losses, 2 * z) if kind.needs_gradient else losses

    whole, part = made(kind), made(kind)
    searched(whole, evaluate, budget=60 * cost(kind))
    searched(part, evaluate, budget=25 * cost(kind))
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **part.history())
    file.seek(0)
    later = replayed(made(kind), np.load(file, allow_pickle=False))
    assert (later.evaluations, later.failed, later.best.loss) == (25, part.failed, part.best.loss)
    np.testing.assert_array_equal(later.ask(), part.ask())
    searched(later, evaluate, budget=60 * cost(kind))
    for name, told in whole.history().items():
        np.testing.assert_array_equal(later.history()[name], told)


@pytest.mark.parametrize("kind", KINDS)
def test_a_search_goes_on_after_its_last_generation(kind):
    optimiser = made(kind)
    before = optimiser.history()
    assert before["z"].shape == (0, 3)
    assert replayed(made(kind), before).evaluations == 0
    searched(optimiser, budget=20 * cost(kind))
    searched(optimiser, budget=40 * cost(kind))
    assert optimiser.evaluations == 40
    assert searched(optimiser, budget=40 * cost(kind)) == []


def test_replays_of_something_else_are_refused():
    part = made(CmaEs)
    searched(part, budget=30)
    history = part.history()
    with pytest.raises(TuningError, match="this seed and these versions: from evaluation 0 on"):
        replayed(made(CmaEs, seed=1), history)
    with pytest.raises(TuningError, match="replay a history with a new one"):
        replayed(part, history)
    with pytest.raises(TuningError, match="lacks gradients"):
        replayed(made(GradientDescent), history)
    with pytest.raises(TuningError, match="different lengths"):
        replayed(made(CmaEs), {**history, "losses": history["losses"][:-1]})
    other = np.array(history["z"])
    other[17, 1] = np.nextafter(other[17, 1], 9.0)
    with pytest.raises(TuningError, match="from evaluation 14 on"):  # generations of 7
        replayed(made(CmaEs), {**history, "z": other})


@pytest.mark.parametrize(("kind", "bad"), [(RandomSearch, np.nan), (CmaEs, np.inf), (CmaEs, -np.inf), (Tpe, np.nan)])
def test_failed_points_count_as_worst(kind, bad):
    """The minimum lies where half of the space has no loss."""
    optimiser = made(kind, size=2)
    *_, last = searched(optimiser, lambda z: np.where(z[:, 0] < 0, bad, sphere(z)), budget=150)
    assert last.failed == optimiser.failed == (~np.isfinite(optimiser.history()["losses"])).sum() > 0
    assert last.best_z[0] >= 0
    assert last.best_loss < (0.5 if kind is RandomSearch else 0.05)


@pytest.mark.parametrize("kind", [RandomSearch, CmaEs, Tpe])
@pytest.mark.parametrize("bad", [np.nan, 1e308, -1e308])
def test_nothing_but_failures_is_survived(kind, bad):
    optimiser = made(kind, size=2)
    budget = 130 if kind is CmaEs else 30  # it restarts within that
    *_, last = searched(optimiser, lambda z: np.where(z[:, 0] < 1.0, np.inf, bad), budget=budget)
    assert np.isfinite(optimiser.ask()).all()
    assert np.isnan(bad) == (last.failed == budget)
    if np.isnan(bad):
        assert last.best_loss == np.inf
        np.testing.assert_array_equal(last.best_z, optimiser.start)


def test_losses_may_be_arrays_of_jax():
    @jax.jit
    def evaluate(z):
        return jax.vmap(jax.value_and_grad(lambda z: (z**2).sum()))(z)

    *_, last = searched(made(GradientDescent, rate=0.1), evaluate, budget=100 * MULTIPLE)
    assert last.best_loss < 1e-2


def test_a_gradient_that_is_not_finite_is_named():
    optimiser = made(GradientDescent, restarts=3)
    z = optimiser.ask()
    optimiser.tell(z[:1], sphere(z[:1]), gradients=2 * z[:1])
    gradients = 2 * z[1:]
    gradients[1, 2] = np.nan
    with pytest.raises(GradientError, match="restart 2 is not finite in parameter 2") as raised:
        optimiser.tell(z[1:], sphere(z[1:]), gradients=gradients)
    assert (raised.value.restart, raised.value.parameter) == (2, 2)
    assert optimiser.evaluations == 1  # whoever knows better may still tell it


def test_a_loss_that_is_not_finite_is_no_hindrance_to_descent():
    optimiser = made(GradientDescent)
    searched(optimiser, lambda z: (np.full(len(z), np.nan), 2 * z), budget=3 * MULTIPLE)
    assert optimiser.failed == 3
    assert sphere(optimiser.ask())[0] < sphere(optimiser.start[None])[0]


def test_what_was_not_asked_for_is_refused():
    optimiser = made(RandomSearch)
    z = optimiser.ask()
    for other in (z + 1e-9, z[1:], z[:0], np.concatenate([z, z]), z.T, np.array(1.0)):
        with pytest.raises(TuningError, match="not the points that were asked for"):
            optimiser.tell(other, np.zeros(len(z)))
    with pytest.raises(TuningError, match=r"losses of 16 points have shape \(16, 1\)"):
        optimiser.tell(z, sphere(z)[:, None])
    with pytest.raises(TuningError, match=r"RandomSearch takes losses$"):
        optimiser.tell(z, sphere(z), gradients=z)
    with pytest.raises(TuningError, match="GradientDescent takes losses and gradients"):
        made(GradientDescent).tell(made(GradientDescent).ask(), np.zeros(1))
    with pytest.raises(TuningError, match=r"gradients have shape \(3,\)"):
        made(GradientDescent).tell(made(GradientDescent).ask(), np.zeros(1), gradients=np.zeros(3))


@pytest.mark.parametrize(
    ("start", "sigma", "seed", "said"),
    [
        (np.zeros(0), 1.0, 0, "start has shape"),
        (np.zeros((2, 2)), 1.0, 0, "start has shape"),
        (np.array([np.nan]), 1.0, 0, "start has shape"),
        (np.zeros(2), 0.0, 0, "sigma is 0"),
        (np.zeros(2), np.inf, 0, "sigma is inf"),
        (np.zeros(2), 1.0, -1, "seed is -1"),
    ],
)
def test_settings_out_of_range_are_refused(start, sigma, seed, said):
    with pytest.raises(TuningError, match=said):
        RandomSearch(start, sigma=sigma, seed=seed)


def test_searches_that_cannot_be_counted_are_refused_at_once():
    with pytest.raises(TuningError, match=r"budget of 2 buys no evaluation of cost 3\.0"):
        minimise(sphere_and_gradient, made(GradientDescent), budget=2, cost_of_gradient=3.0)
    with pytest.raises(TuningError, match="budget of nan"):
        minimise(sphere, made(RandomSearch), budget=np.nan)
    with pytest.raises(TuningError, match="cost_of_gradient is None: measure"):
        minimise(sphere_and_gradient, made(GradientDescent), budget=20)
    with pytest.raises(TuningError, match="RandomSearch needs losses alone"):
        searched(made(RandomSearch), sphere_and_gradient, budget=20)
    with pytest.raises(TuningError, match=r"GradientDescent needs \(losses, gradients\)"):
        searched(made(GradientDescent), sphere, budget=20)


@pytest.mark.parametrize(("kind", "name"), LIBRARIES)
def test_a_library_that_is_absent_is_named_with_the_remedy(kind, name, monkeypatch):
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(TuningError, match=rf'{name} is not installed: pip install "urbanjax\[tuning\]"'):
        made(kind)
