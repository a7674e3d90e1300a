"""Cost terms of the Frenet candidates."""

import numpy as np

from tests.planning.frenet_sampling.helpers import (
    WISH,
    curved,
    each,
    fan_of,
    grid,
    line_of,
    motions,
    plan_of,
    scene_params,
    state,
)
from urbanjax.planning.frenet_sampling.choice import FRENET_TERMS


def test_the_costs_are_roots_of_integrals(x64):
    line, params = line_of(curved, spacing=0.02), scene_params()
    terms = np.asarray(plan_of(line).terms).reshape(len(FRENET_TERMS), -1)
    time = 0.1 * np.arange(26)
    speed = each(fan_of(line, state(), grid()).speed)
    weights = [getattr(params.weights, name) for name in FRENET_TERMS]
    for i, (end, s, across, d) in enumerate(motions()):
        fine = np.linspace(0, end, 3001)
        wanted = [np.sqrt(np.trapezoid(p.deriv(3)(fine) ** 2, fine)) for p in (across, s)]
        wanted.append(np.sqrt(0.1 * np.sum((speed[i] - WISH) ** 2)))
        wanted.append(np.sqrt(0.1 * np.sum(d(np.minimum(time, end))[13:] ** 2)))
        np.testing.assert_allclose(terms[:, i], np.multiply(weights, wanted), rtol=1e-5, atol=1e-9)
