"""What samples fill: a curve has one dimension, a cloud two, a single place none."""

import jax
import numpy as np

from urbanjax.traffic.divergence.dimension import effective_dimension

N = 2000


def test_curves_clouds_and_places():
    rng = np.random.default_rng(0)
    t = rng.uniform(0, 6, N)
    curve = np.stack([20 * np.cos(t), 10 * np.sin(2 * t)], axis=1)
    cloud = rng.random((N, 2))
    place = np.ones((N, 2))
    points = np.stack([curve, cloud, place]).astype(np.float32)
    found = jax.jit(effective_dimension)(points, np.ones((3, N), bool))
    np.testing.assert_allclose(found, [1, 2, 0], atol=0.08)
