"""The window's radius by speed."""

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.localization.sliding import SlidingParams, radius


def test_radius_grows_with_speed_within_its_limits():
    params = SlidingParams(standing=60.0, per_speed=2.0, smallest=70.0, largest=100.0)
    found = jax.vmap(lambda v: radius(v, params))(jnp.array([0.0, 5.0, 10.0, 16.0, 30.0]))
    np.testing.assert_allclose(found, [70.0, 70.0, 80.0, 92.0, 100.0])
