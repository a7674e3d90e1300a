"""Losses whose least value is known, and searches of them."""

import numpy as np

from urbanjax.tuning import CmaEs, GradientDescent, RandomSearch, Tpe, minimise

KINDS = (RandomSearch, CmaEs, Tpe, GradientDescent)
MULTIPLE = 3.0  # what a gradient costs here


def at(size, *, distance):
    return np.full(size, distance / np.sqrt(size))


def sphere(z):
    return (z**2).sum(axis=1)


def sphere_and_gradient(z):
    return sphere(z), 2 * z


def rosenbrock(z):
    return (100 * (z[:, 1:] - z[:, :-1] ** 2) ** 2 + (1 - z[:, :-1]) ** 2).sum(axis=1)


def made(kind, *, size=3, distance=2.0, sigma=1.0, seed=0, **settings):
    return kind(at(size, distance=distance), sigma=sigma, seed=seed, **settings)


def searched(optimiser, evaluate=None, *, budget):
    evaluate = evaluate or (sphere_and_gradient if optimiser.needs_gradient else sphere)
    return list(minimise(evaluate, optimiser, budget=budget, cost_of_gradient=MULTIPLE))
