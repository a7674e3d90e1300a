"""The cosine to an evolution strategy: known answers on quadratics."""

import numpy as np
import pytest

from urbanjax.tuning.evolution import cosine_to_evolution

CURVED = np.diag([1.0, 4.0, 0.5, 2.0, 3.0])
Z = np.array([1.0, -2.0, 0.5, 0.0, 1.5])


def loss(points):
    return 0.5 * np.einsum("ni,ij,nj->n", points, CURVED, points)


@pytest.mark.parametrize("count", [2, 5])
@pytest.mark.parametrize(("sign", "cosine"), [(1, 1.0), (-1, -1.0)])
def test_the_true_gradient_of_a_quadratic_has_cosine_one(count, sign, cosine):
    found = cosine_to_evolution(loss, Z, gradient=sign * CURVED @ Z, sigma=0.3, seed=1, count=count)
    assert found == pytest.approx(cosine, abs=1e-9)


def test_a_gradient_across_has_cosine_zero_where_every_direction_is_looked_in():
    true = CURVED @ Z
    across = np.ones(5) - true * (true @ np.ones(5)) / (true @ true)
    assert cosine_to_evolution(loss, Z, gradient=across, sigma=0.3, seed=1, count=5) == pytest.approx(0.0, abs=1e-9)


def test_nothing_to_compare_is_no_number():
    assert np.isnan(cosine_to_evolution(loss, Z, gradient=np.zeros(5), sigma=0.3, seed=1))
    assert np.isnan(cosine_to_evolution(lambda p: np.zeros(len(p)), Z, gradient=Z, sigma=0.3, seed=1))
