"""Kriging reproduces what it was told, with the slopes that it was told, and is unsure elsewhere."""

import numpy as np
import pytest

from urbanjax.tuning.adversary import Observed, krige


def value(x: np.ndarray) -> np.ndarray:
    return np.sin(2 * x[:, 0]) + 0.3 * x[:, 1] ** 2


def slope(x: np.ndarray) -> np.ndarray:
    return np.stack([2 * np.cos(2 * x[:, 0]), 0.6 * x[:, 1], 0 * x[:, 2]], axis=1)


def observed(count: int, sloped: int) -> Observed:
    x = np.random.default_rng(0).uniform(-1, 1, size=(count, 3))
    return Observed(x, value(x), slope(x[:sloped]), np.arange(sloped))


def test_the_model_has_the_slopes_that_it_was_told():
    seen, step = observed(12, 12), 1e-5
    model = krige(seen)
    for k in range(3):
        aside = step * np.eye(3)[k]
        told = (model.at(seen.points + aside)[0] - model.at(seen.points - aside)[0]) / (2 * step)
        assert told == pytest.approx(seen.slopes[:, k], abs=0.25)


def test_slopes_that_contradict_values_are_not_trusted():
    seen = observed(30, 10)
    wrong = Observed(seen.points, seen.values, -20 * seen.slopes, seen.sloped)
    assert krige(seen).trusts
    assert not krige(wrong).trusts
    assert np.abs(krige(wrong).at(seen.points)[0] - seen.values).max() < 0.3


def test_what_was_told_is_known_and_what_is_far_is_not():
    seen = observed(30, 10)
    model = krige(seen)
    mean, deviation = model.at(seen.points)
    assert np.abs(mean - seen.values).max() < 0.1
    far = model.at(np.full((1, 3), 9.0))
    assert far[0][0] == pytest.approx(model.mean, abs=0.1)
    assert far[1][0] > 3 * deviation.mean()


def test_slopes_make_a_model_of_few_points_better_and_tell_which_numbers_matter():
    anywhere = np.random.default_rng(1).uniform(-1, 1, size=(200, 3))
    errors = [np.abs(krige(observed(15, n)).at(anywhere)[0] - value(anywhere)).mean() for n in (0, 15)]
    assert errors[1] < 0.5 * errors[0]
    lengths = krige(observed(15, 15)).lengths
    assert max(lengths[:2]) < lengths[2]


def test_equal_values_are_no_trouble():
    x = np.random.default_rng(0).uniform(-1, 1, size=(5, 2))
    mean, deviation = krige(Observed(x, np.ones(5), np.zeros((0, 2)), np.zeros(0, int))).at(x)
    assert np.allclose(mean, 1)
    assert np.isfinite(deviation).all()
