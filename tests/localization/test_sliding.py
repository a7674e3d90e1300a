"""The window of the map: its radius by speed, and maps that were altered."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.localization.sliding import SlidingParams, radius, window
from urbanjax.registration.voxelmap import CutParams, padded, without
from urbanjax.types import CloudError


def test_radius_grows_with_speed_within_its_limits():
    params = SlidingParams(standing=60.0, per_speed=2.0, smallest=70.0, largest=100.0)
    found = jax.vmap(lambda v: radius(v, params))(jnp.array([0.0, 5.0, 10.0, 16.0, 30.0]))
    np.testing.assert_allclose(found, [70.0, 70.0, 80.0, 92.0, 100.0])


def window_of(world, position):
    params = SlidingParams(smallest=40.0, standing=40.0, cut=CutParams(capacity=8192, shape=(96, 96, 16)))
    return jax.jit(window)(world, position, speed=jnp.zeros(()), params=params)


def test_a_padded_map_has_the_same_windows(street):
    larger = padded(street.map, len(street.map.cell) + 1000, tiles=max(street.map.start.shape) + 3)
    for x in (0.0, 60.0, 199.0):
        one, other = (window_of(world, jnp.array([x, 2.0, 0.0])) for world in (street.map, larger))
        for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
            np.testing.assert_array_equal(a, b)
        assert int(jnp.sum(one[0].rows[:, 9] > 0)) > 500
    with pytest.raises(CloudError, match="does not fit into 100,"):
        padded(street.map, 100, tiles=48)


def test_a_gap_in_the_map_is_a_slab_across_the_road(street):
    heading = jnp.asarray(0.0)
    holed = jax.jit(without)(street.map, jnp.array([100.0, 0.0]), heading=heading, length=jnp.asarray(30.0))

    def means(world):
        kept = np.asarray(world.rows[:, 9]) > 0
        return np.asarray((world.cell + world.first[None]) * world.resolution + world.rows[:, :3])[kept]

    before, after = means(street.map), means(holed)
    inside = np.abs(before[:, 0] - 100.0) < 15.0
    assert inside.sum() > 500
    np.testing.assert_array_equal(after, before[~inside])
    turned = jax.jit(without)(
        street.map, jnp.array([100.0, 0.0]), heading=heading + jnp.pi / 2, length=jnp.asarray(30.0)
    )
    assert np.abs(means(turned)[:, 1][np.abs(means(turned)[:, 0] - 100.0) < 100.0]).min() >= 15.0 - 1e-3
